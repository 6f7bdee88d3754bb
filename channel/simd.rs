//! The instruction sets that pixels can be made with, and the choice of one.
//!
//! Every kernel is one generic body over `fearless_simd`'s token, compiled for each level and entered by one `at_level` per run
//! of geometry and per tile. All levels give the same bits: kernels use + − × ÷ √, comparisons and integers only, no fused
//! multiply-add, no approximate reciprocals, no sums whose order depends on a width. `scalar` is the twin that the others are
//! tested against.

use fearless_simd::Level;
use std::fmt;
use std::str::FromStr;
use thiserror::Error;

/// Runs a kernel at a [`Level`]: `at_level!(level, simd => kernel(simd, …))`. `fearless_simd`'s own dispatch would compile it for SSE2 as
/// well, a fifth more to build for machines older than 2008; those are served by `scalar`.
macro_rules! at_level {
    ($level:expr, $simd:ident => $kernel:expr) => {
        match $level {
            #[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
            fearless_simd::Level::Sse4_2(token) => $crate::simd::at_level!(@with token, $simd => $kernel),
            #[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
            fearless_simd::Level::Avx2(token) => $crate::simd::at_level!(@with token, $simd => $kernel),
            #[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
            fearless_simd::Level::Avx512(token) => $crate::simd::at_level!(@with token, $simd => $kernel),
            #[cfg(target_arch = "aarch64")]
            fearless_simd::Level::Neon(token) => $crate::simd::at_level!(@with token, $simd => $kernel),
            fearless_simd::Level::Fallback(token) => $crate::simd::at_level!(@with token, $simd => $kernel),
            _ => unreachable!("levels come from `SimdLevel::all`"),
        }
    };
    (@with $token:ident, $simd:ident => $kernel:expr) => {{
        let $simd = $token;
        fearless_simd::Simd::vectorize(
            $simd,
            #[inline(always)]
            || $kernel,
        )
    }};
}
pub(crate) use at_level;

/// `array.map`, inlined for sure. The standard one is a function of its own that doesn't have the features of the level it is called
/// from: closures with vectors in them would then run without, through memory.
#[inline(always)]
pub(crate) fn each3<T, U>([a, b, c]: [T; 3], mut f: impl FnMut(T) -> U) -> [U; 3] {
    [f(a), f(b), f(c)]
}

/// See [`each3`].
#[inline(always)]
pub(crate) fn each2<T, U>([a, b]: [T; 2], mut f: impl FnMut(T) -> U) -> [U; 2] {
    [f(a), f(b)]
}

/// See [`each3`].
#[inline(always)]
pub(crate) fn each4<T, U>([a, b, c, d]: [T; 4], mut f: impl FnMut(T) -> U) -> [U; 4] {
    [f(a), f(b), f(c), f(d)]
}

/// An instruction set that this machine has.
#[derive(Clone, Copy, Debug)]
pub struct SimdLevel {
    name: &'static str,
    level: Level,
}

/// A level's name was not understood, or this machine doesn't have it.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum SimdLevelError {
    /// No such level.
    #[error("no instruction set is called {name:?}; this machine has {}", names())]
    Unknown {
        /// What was asked for.
        name: String,
    },
}

fn names() -> String {
    let names: Vec<&str> = SimdLevel::all().iter().map(|level| level.name).collect();
    names.join(", ")
}

impl SimdLevel {
    /// The best of this machine.
    pub fn best() -> Self {
        *Self::all().last().expect("scalar is always there")
    }

    /// All that this machine has, the slowest first.
    pub fn all() -> Vec<Self> {
        let best = Level::new();
        let mut all = vec![Self { name: "scalar", level: Level::fallback() }];
        #[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
        {
            let named = |name, level: Option<Level>| level.map(|level| Self { name, level });
            all.extend(named("sse4.2", best.as_sse4_2().map(Level::Sse4_2)));
            all.extend(named("avx2", best.as_avx2().map(Level::Avx2)));
            all.extend(named("avx512", best.as_avx512().map(Level::Avx512)));
        }
        #[cfg(target_arch = "aarch64")]
        all.extend(best.as_neon().map(|neon| Self { name: "neon", level: Level::Neon(neon) }));
        #[cfg(not(any(target_arch = "x86", target_arch = "x86_64", target_arch = "aarch64")))]
        let _ = best;
        all
    }

    /// The token to dispatch on.
    pub(crate) fn level(self) -> Level {
        self.level
    }

    /// Its name, as `--simd` takes it.
    pub fn name(self) -> &'static str {
        self.name
    }
}

impl Default for SimdLevel {
    fn default() -> Self {
        Self::best()
    }
}

impl fmt::Display for SimdLevel {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name)
    }
}

impl FromStr for SimdLevel {
    type Err = SimdLevelError;

    fn from_str(name: &str) -> Result<Self, Self::Err> {
        let found = Self::all().into_iter().find(|level| level.name == name);
        found.ok_or_else(|| SimdLevelError::Unknown { name: name.to_owned() })
    }
}

/// For tests of one kernel: all levels of this machine.
#[cfg(test)]
pub(crate) fn every_level() -> Vec<Level> {
    SimdLevel::all().into_iter().map(SimdLevel::level).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn levels_are_found_by_name() {
        for level in SimdLevel::all() {
            assert_eq!(level.name().parse::<SimdLevel>().unwrap().name(), level.name());
        }
        let error = "mmx".parse::<SimdLevel>().unwrap_err().to_string();
        assert!(error.contains("scalar"), "{error}");
    }
}
