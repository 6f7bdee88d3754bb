//! Planes of the scene: the one plane of inverse distance that all faces lying in it share.
//!
//! A marking and the runway below it have rounded vertices of their own, and planes through these would cross each other many times.
//! So faces that the table says lie in one plane take their inverse distance from *that*: n · P = d in view axes is
//! q = 1/w = (n · ray) / d, affine on the screen, and the same bits for every face, because it is computed from the
//! plane's row, its object's transformation and the camera alone. Between two such faces depth is then equal
//! everywhere and the larger (layer, primitive, face) wins at every sample, at any distance and angle.
//!
//! How far off can it be? The plane is exact at a sample, while the face's rounded outline is displaced by up to half
//! a sub-pixel; near the plane's own horizon, where q changes fast, the sample may see what the plane shows half a sub-pixel
//! farther on, or beyond the horizon (q ≤ 0: farther than everything). That is the displacement that rounding the outline
//! means anyway.
//!
//! Edge on, d goes to 0 and q to infinity. Where |d| is below near · (a sub-pixel's width), all of the plane beyond
//! the near plane lies within one sub-pixel of its horizon: a line of which nothing but rounding is seen. The
//! plane is then no use, and all its faces take their depth from their own vertices. This depends on plane and camera only, so that
//! every board decides alike whatever part of the faces it draws.

use super::camera::Camera;
use super::setup::Plane;
use crate::store::SceneStore;
use glam::{DAffine3, DMat3};
use proto::ids::PlaneId;
use proto::scene::PlaneRow;

/// The plane that was asked for last, and what it was.
pub type LastPlane = Option<(PlaneId, Option<Plane>)>;

/// The planes of a subobject's faces.
#[derive(Clone, Copy, Debug)]
pub struct FacePlanes<'a> {
    scene: &'a SceneStore,
    object: usize,
    begin: usize,
}

impl<'a> FacePlanes<'a> {
    /// Of a subobject of that object, its faces' planes beginning there.
    pub(crate) fn new(scene: &'a SceneStore, object: usize, begin: usize) -> Self {
        Self { scene, object, begin }
    }

    /// The plane that face number `face` of the mesh takes its depth from, if not from its own vertices. `last` is kept by the
    /// caller from face to face of one subobject: neighbours mostly lie in the same plane.
    pub fn of_face(&self, camera: &Camera, face: usize, last: &mut LastPlane) -> Option<Plane> {
        let id = self.scene.face_plane(self.begin, face)?;
        match last {
            Some((known, plane)) if *known == id => *plane,
            _ => {
                let placed = self.scene.placed_plane(self.object, id);
                let plane = placed.and_then(|(row, transform)| on_screen(camera, row, transform));
                *last = Some((id, plane));
                plane
            }
        }
    }
}

/// The inverse distance of a plane over the screen; `None` where it is seen edge on or has no number.
fn on_screen(camera: &Camera, row: &PlaneRow, transform: &DAffine3) -> Option<Plane> {
    let linear = transform.matrix3;
    // Lengths of normals don't matter, nor their sign: q is a quotient of two that are linear in the normal.
    let normal = camera.view_axes(cofactors(&linear) * row.normal).normalize_or_zero();
    let place = camera.view_axes(linear * (row.normal * row.offset) + camera.relative(transform));
    let d = normal.dot(place);
    let [left, top] = camera.ray(0, 0);
    let [step_x, step_y] = camera.steps();
    let (dx, dy) = (normal.x * step_x, -normal.y * step_y);
    if d.abs() <= camera.near * dx.abs().max(dy.abs()) {
        return None;
    }
    let plane = Plane { q: (normal.x * left + normal.y * top - normal.z) / d, dx: dx / d, dy: dy / d, x: 0, y: 0 };
    [plane.q, plane.dx, plane.dy].iter().all(|n| n.is_finite()).then_some(plane)
}

/// What carries normals: the inverse transpose times the determinant, which exists for flattened objects as well.
pub(crate) fn cofactors(linear: &DMat3) -> DMat3 {
    DMat3::from_cols(
        linear.y_axis.cross(linear.z_axis),
        linear.z_axis.cross(linear.x_axis),
        linear.x_axis.cross(linear.y_axis),
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::oracle::{Random, state, view};
    use glam::{DQuat, DVec3};
    use proto::ids::ObjectId;
    use proto::view::{Pose, Samples};

    #[test]
    fn a_planes_inverse_distance_is_that_of_its_points_but_for_rounding_the_outline() {
        let mut random = Random(0xF1A7);
        let mut vector = || DVec3::new(random.signed(), random.signed(), random.signed());
        let mut compared = 0;
        for _ in 0..2000 {
            let turned = DQuat::from_rotation_arc(DVec3::Z, vector().normalize());
            let matrix3 = DMat3::from_quat(turned) * DMat3::from_diagonal(vector() * 3.0);
            let transform = DAffine3 { matrix3, translation: vector() * 1e6 };
            let mut state = state();
            let orientation = DQuat::from_rotation_arc(DVec3::Z, vector().normalize());
            state.eye = Pose { position: transform.translation + vector() * 10.0, orientation };
            let camera = Camera::new(&state, &view(640, 480, Samples::One));
            let row = PlaneRow { object: ObjectId(0), normal: vector().normalize(), offset: vector().x * 5.0 };
            let Some(plane) = on_screen(&camera, &row, &transform) else { continue };
            let (u, v) = row.normal.any_orthonormal_pair();
            for _ in 0..20 {
                let place = vector() * 20.0;
                let on_plane = row.normal * row.offset + u * place.x + v * place.y;
                let point = camera.view_point(matrix3 * on_plane + camera.relative(&transform));
                let [x, y] = camera.project(point).map(|c| c.abs());
                if point.w < camera.near || x > 1e4 || y > 1e4 {
                    continue;
                }
                let [x, y] = camera.project_sub(point);
                // The sub-pixel position is at most half a one aside; positions are known to about 1e-9 m at 10⁶ m.
                let bound = 0.5 * (plane.dx.abs() + plane.dy.abs()) * 1.001 + 1e-6 / point.w;
                let error = (plane.at(x, y) - 1.0 / point.w).abs();
                assert!(error <= bound, "{error:e} exceeds {bound:e}");
                compared += 1;
            }
        }
        assert!(compared > 5000, "{compared} points were compared");
    }

    #[test]
    fn a_plane_through_the_eye_or_without_a_normal_is_no_use() {
        let camera = Camera::new(&state(), &view(640, 480, Samples::One));
        let through = |normal: DVec3, offset: f64, transform: &DAffine3| {
            on_screen(&camera, &PlaneRow { object: ObjectId(0), normal, offset }, transform).is_some()
        };
        assert!(!through(DVec3::Y, 0.0, &DAffine3::IDENTITY));
        assert!(!through(DVec3::Y, 1e-6, &DAffine3::IDENTITY), "a micrometre below the eye is less than a sub-pixel");
        assert!(through(DVec3::Y, 1e-3, &DAffine3::IDENTITY));
        assert!(!through(DVec3::ZERO, 1.0, &DAffine3::IDENTITY));
        assert!(!through(DVec3::Y, 1.0, &DAffine3::from_scale(DVec3::ZERO)), "an object without a size");
        assert!(!through(DVec3::Y, 1.0, &DAffine3::from_scale(DVec3::splat(1e200))), "out of all range");
    }
}
