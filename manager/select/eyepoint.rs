//! Views that share an eyepoint, and what they ask of balls: all of them at once.
//!
//! The paper transforms every object into the pilot's frame and compares there. Here the planes of the views are taken to the world instead,
//! once a frame, so that a ball costs one subtraction, the transformation to the eye, however many views look from there; what is
//! left is a dot product per plane. Answers are bit masks of views for one ball, and bit masks of objects for a block.
//!
//! The loops over blocks are written plainly over arrays of 64 and compiled for each instruction set (`fearless_simd`); they use + − × and
//! comparisons, in the order in which [`Frustum::ball`] and [`super::power`] do, so that they give the bits of those whatever the
//! instruction set. They are not in f32: the exact answer costs no second look, and what a block takes is dominated by what follows.

use super::frustum::{Frustum, Where};
use crate::scene::blocks::{BLOCK, Blocks};
use fearless_simd::{Level, Simd, dispatch};
use glam::DVec3;
use proto::scene::Sphere;
use proto::view::{Pose, View};

/// Bit v: view v of the frame.
pub(super) type Views = u64;

/// Bit k: object k of a block.
pub(super) type Objects = u64;

const _: () = assert!(
    proto::limits::VIEWS_MAX <= Views::BITS as usize && BLOCK == Objects::BITS as usize,
    "a view, and an object of a block, is a bit of a word"
);

/// Views that look from one point.
#[derive(Clone, Debug)]
pub(super) struct Eyepoint {
    pub(super) apex: DVec3,
    /// Which views of the frame.
    pub(super) views: Views,
}

/// The eyepoints of a frame's views, by their first view. Replaces the content of both.
pub(super) fn eyepoints(
    eye: Pose,
    views: &[View],
    visibility_m: Option<f64>,
    frusta: &mut Vec<Frustum>,
    out: &mut Vec<Eyepoint>,
) {
    frusta.clear();
    out.clear();
    for (number, view) in views.iter().enumerate() {
        let frustum = Frustum::new(eye, view, visibility_m);
        let apex = frustum.apex();
        match out.iter_mut().find(|eyepoint| eyepoint.apex == apex) {
            Some(eyepoint) => eyepoint.views |= 1 << number,
            None => out.push(Eyepoint { apex, views: 1 << number }),
        }
        frusta.push(frustum);
    }
}

/// The numbers of the bits that are set, ascending.
pub(super) fn bits(mut mask: u64) -> impl Iterator<Item = usize> {
    std::iter::from_fn(move || {
        let bit = (mask != 0).then(|| mask.trailing_zeros() as usize);
        mask &= mask.wrapping_sub(1);
        bit
    })
}

/// A mask of the lowest `count` bits, at most 64.
pub(super) fn lowest(count: usize) -> u64 {
    if count >= 64 { u64::MAX } else { (1 << count) - 1 }
}

/// The objects of a block as seen from an apex. Beyond the last one is anything.
#[derive(Clone, Debug)]
pub(super) struct Near {
    /// Centres, from the apex, m.
    pub(super) x: [f64; BLOCK],
    pub(super) y: [f64; BLOCK],
    pub(super) z: [f64; BLOCK],
    /// m.
    pub(super) radius: [f64; BLOCK],
    /// Squares of the distances from the apex, m².
    pub(super) squared: [f64; BLOCK],
}

impl Default for Near {
    fn default() -> Self {
        let none = [0.0; BLOCK];
        Self { x: none, y: none, z: none, radius: none, squared: none }
    }
}

impl Near {
    /// Takes in a block.
    pub(super) fn load(&mut self, level: Level, blocks: &Blocks, block: usize, apex: DVec3) {
        let (grid, balls) = (blocks.grids[block], &blocks.objects[block]);
        dispatch!(level, simd => simd.vectorize(#[inline(always)] || {
            for k in 0..BLOCK {
                self.x[k] = (grid.origin.x + f64::from(balls.x[k]) * grid.unit) - apex.x;
                self.y[k] = (grid.origin.y + f64::from(balls.y[k]) * grid.unit) - apex.y;
                self.z[k] = (grid.origin.z + f64::from(balls.z[k]) * grid.unit) - apex.z;
                self.radius[k] = f64::from(balls.radius[k]) * grid.unit;
            }
            self.measure();
        }));
    }

    /// Takes in one ball.
    pub(super) fn put(&mut self, k: usize, ball: Sphere, apex: DVec3) {
        let from = ball.centre - apex;
        (self.x[k], self.y[k], self.z[k], self.radius[k]) = (from.x, from.y, from.z, ball.radius);
    }

    /// Measures distances after [`Self::put`].
    pub(super) fn measure_all(&mut self, level: Level) {
        dispatch!(level, simd => simd.vectorize(#[inline(always)] || self.measure()));
    }

    #[inline(always)]
    fn measure(&mut self) {
        for k in 0..BLOCK {
            self.squared[k] = (self.x[k] * self.x[k]) + (self.y[k] * self.y[k]) + (self.z[k] * self.z[k]);
        }
    }

    /// Those whose radius, `reach` times as large, is at least their distance: what spans enough display elements.
    pub(super) fn large(&self, level: Level, reach: f64) -> Objects {
        let reach = reach * reach;
        dispatch!(level, simd => simd.vectorize(#[inline(always)] || {
            mask_of(#[inline(always)] |k| self.radius[k] * self.radius[k] * reach >= self.squared[k])
        }))
    }

    /// Those that overlap a ball of this radius round the apex.
    pub(super) fn touching(&self, level: Level, radius: f64) -> Objects {
        dispatch!(level, simd => simd.vectorize(#[inline(always)] || {
            mask_of(#[inline(always)] |k| {
                let reach = radius + self.radius[k];
                self.squared[k] < reach * reach
            })
        }))
    }

    /// Those outside of a frustum from the same apex, and those inside: for each what [`Frustum::ball`] says.
    pub(super) fn ask(&self, level: Level, frustum: &Frustum) -> (Objects, Objects) {
        let mut slack = [0.0; BLOCK];
        let (mut outside, mut inside) = (0, u64::MAX);
        dispatch!(level, simd => simd.vectorize(#[inline(always)] || {
            for (k, slack) in slack.iter_mut().enumerate() {
                *slack = Frustum::slack([self.x[k], self.y[k], self.z[k]], self.radius[k]);
            }
            for (normal, distance) in frustum.planes() {
                let by: [f64; BLOCK] = std::array::from_fn(#[inline(always)] |k| {
                    (normal.x * self.x[k]) + (normal.y * self.y[k]) + (normal.z * self.z[k]) - distance
                });
                outside |= mask_of(#[inline(always)] |k| by[k] < -(self.radius[k] + slack[k]));
                inside &= !mask_of(#[inline(always)] |k| by[k] < self.radius[k] + slack[k]);
            }
        }));
        if frustum.has_range() {
            // Few of a frame's blocks lie across a border, and most of their objects are outside of a plane.
            for k in bits(!outside) {
                let centre = DVec3::new(self.x[k], self.y[k], self.z[k]);
                match frustum.within_range_of(centre, self.squared[k], self.radius[k], slack[k]) {
                    Where::Outside => outside |= 1 << k,
                    Where::Across => inside &= !(1 << k),
                    Where::Inside => {}
                }
            }
        }
        (outside, inside & !outside)
    }
}

#[inline(always)]
fn mask_of(is: impl Fn(usize) -> bool) -> Objects {
    let mut mask = 0;
    for k in 0..BLOCK {
        mask |= u64::from(is(k)) << k;
    }
    mask
}
