//! The way out for pixels that would need too many regions: points.

use super::ExactFace;
use super::cells::compose;
use super::prepare::Faces;
use crate::room::room;
use crate::translucency::models::Mix;

/// Points of a pixel that is sampled, a Fibonacci number: with the one before it as the step, the points of such a lattice are
/// as evenly spread as any, in all directions.
pub const SAMPLES_INSTEAD: u32 = 1597;
const STEP: u32 = 987;

/// Buffers for sampling.
#[derive(Debug, Default)]
pub(super) struct Points {
    stack: Vec<(f64, usize)>,
    mix: Mix,
}

room!(Points: stack, mix;);

impl Points {
    pub(super) fn colour(&mut self, faces: &[ExactFace<'_>], order: &Faces, background: [f64; 3]) -> [f64; 3] {
        let mut sum = [0.0; 3];
        let cell = 1.0 / f64::from(SAMPLES_INSTEAD);
        for i in 0..SAMPLES_INSTEAD {
            let point = [i, i * STEP % SAMPLES_INSTEAD].map(|k| (f64::from(k) + 0.5) * cell);
            self.stack.clear();
            for k in 0..order.len() {
                let face = order.at(k);
                if face.lines().iter().all(|line| line.at(point) > 0.0) {
                    self.stack.push((face.q_at(point), k));
                }
            }
            let nearest_first = |a: &(f64, usize), b: &(f64, usize)| b.0.total_cmp(&a.0).then(order.by_rank(a.1, b.1));
            self.stack.sort_unstable_by(nearest_first);
            let stack = self.stack.iter().map(|(_, k)| order.at(*k));
            let (rgb, transmitted) = compose(&mut self.mix, faces, stack);
            for ((sum, c), behind) in sum.iter_mut().zip(rgb).zip(background) {
                *sum += c + behind * transmitted;
            }
        }
        sum.map(|c| c * cell)
    }
}
