//! The compositor.
