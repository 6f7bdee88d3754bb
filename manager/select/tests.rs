//! Selection against the plainest way to do it, and against rays.

use super::*;
use crate::scene::split::{Primitive, split};
use crate::scene::{Entities, Extras, NodeIndex, NodeSource, Parts, PieceSource, Scene, bounds};
use glam::{DAffine3, DQuat};
use proptest::prelude::*;
use proto::frame::VersionWeights;
use proto::ids::ObjectId;
use proto::view::{Samples, Tangents};

/// A box of `size`, its faces cut into `cells`² squares so that large counts give several pieces.
fn block(size: DVec3, cells: u32) -> Primitive {
    let mut primitive = Primitive::default();
    for face in 0..6u32 {
        let axis = (face / 2) as usize;
        let first = primitive.positions.len() as u32;
        for j in 0..=cells {
            for i in 0..=cells {
                let mut p = [0.0; 3];
                p[axis] = if face % 2 == 0 { -0.5 } else { 0.5 };
                p[(axis + 1) % 3] = f64::from(i) / f64::from(cells) - 0.5;
                p[(axis + 2) % 3] = f64::from(j) / f64::from(cells) - 0.5;
                primitive.positions.push((DVec3::from_array(p) * size).as_vec3().to_array());
            }
        }
        for j in 0..cells {
            for i in 0..cells {
                let a = first + j * (cells + 1) + i;
                primitive.triangles.push([a, a + 1, a + cells + 1]);
                primitive.triangles.push([a + 1, a + cells + 2, a + cells + 1]);
            }
        }
    }
    primitive
}

/// Objects in a chain of nodes or flat: (shape, place, turn, scale, whether a child of the node before).
type Plan = Vec<(usize, DVec3, DQuat, DVec3, bool)>;

fn build(plan: &Plan) -> Scene {
    let mut parts = Parts::default();
    let shapes: Vec<_> = [(DVec3::ONE, 1), (DVec3::new(1.0, 8.0, 2.0), 4), (DVec3::new(60.0, 0.5, 40.0), 48)]
        .into_iter()
        .map(|(size, cells)| {
            let pieces = PieceSource::plain(split(&block(size, cells)), 0);
            parts.add_shape("block", Extras::default(), pieces)
        })
        .collect();
    for (i, &(shape, place, rotation, scale, below)) in plan.iter().enumerate() {
        parts.nodes.push(NodeSource {
            name: format!("n{i}"),
            parent: (below && i > 0).then(|| i as u32 - 1),
            local: DAffine3::from_scale_rotation_translation(scale, rotation, place),
            rotation,
            shape: shapes[shape],
            ..NodeSource::default()
        });
    }
    Scene::assemble(parts).unwrap()
}

fn view(tangents: Tangents, offset: Pose) -> View {
    View { offset, tangents, width: 640, height: 360, near: 0.1, samples: Samples::One }
}

/// What one view sees.
fn select(
    scene: &Scene,
    entities: &Entities,
    weights: &[VersionWeights],
    eye: Pose,
    view: &View,
    visibility_m: Option<f64>,
) -> Selection {
    let mut selector = Selector::new();
    let sight = Sight::whole(eye, std::slice::from_ref(view), visibility_m);
    assert!(selector.select(scene, entities, weights, &sight), "the first answer is new");
    selector.found()[0].clone()
}

/// The ball of an object where `entities` has it.
fn object_ball(scene: &Scene, entities: &Entities, id: ObjectId) -> Sphere {
    match entities.moved_number(id) {
        Some(moved) => entities.objects()[moved].sphere,
        None => scene.blocks.ball(scene.blocks.slot(id.0)),
    }
}

/// The ball of an object's piece where `entities` has it.
fn piece_ball(scene: &Scene, entities: &Entities, id: ObjectId, piece: usize) -> Sphere {
    if entities.is_moved(id) {
        let shape = scene.shape_of(scene.object(id));
        return bounds::ball_moved(&entities.transform(scene, id), shape.pieces[piece].sphere);
    }
    let slot = scene.blocks.slot(id.0);
    scene.blocks.piece_ball(slot, scene.blocks.places(slot).start + piece)
}

/// Every subobject asked by itself, in order of its key.
fn plain(scene: &Scene, entities: &Entities, eye: Pose, view: &View, visibility_m: Option<f64>) -> Vec<SubobjectId> {
    let frustum = Frustum::new(eye, view, visibility_m);
    let mut found = Vec::new();
    for (i, row) in scene.table.subobjects.iter().enumerate() {
        let object = scene.object(row.object);
        let number = i - object.first_subobject.0 as usize;
        let piece = scene.shape_of(object).pieces[number];
        let transform = entities.transform(scene, row.object);
        let ball = piece_ball(scene, entities, row.object, number);
        let seen = frustum.ball(ball) == Where::Inside
            || frustum.ball(ball) == Where::Across && !frustum.misses_box(&transform, piece.bounds);
        if seen {
            found.push((power(frustum.apex(), ball), SubobjectId(i as u32)));
        }
    }
    found.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    found.into_iter().map(|(_, id)| id).collect()
}

/// Where a ray from `eye` enters and leaves a ball.
fn hit(eye: DVec3, direction: DVec3, ball: Sphere) -> Option<(f64, f64)> {
    let to = ball.centre - eye;
    let along = to.dot(direction);
    let reach = ball.radius * ball.radius - (to - direction * along).length_squared();
    (reach > 0.0).then(|| (along - reach.sqrt(), along + reach.sqrt()))
}

/// manager.md's case: disjoint, the far ball nearer by centre.
#[test]
fn power_order_beats_centre_distance() {
    let angle = 41.5f64.to_radians();
    let large = Sphere { centre: DVec3::new(0.0, 0.0, -150.0), radius: 100.0 };
    let small = Sphere { centre: DVec3::new(angle.sin(), 0.0, -angle.cos()) * 135.0, radius: 1.0 };
    let eye = DVec3::ZERO;
    assert!(large.centre.distance(small.centre) > large.radius + small.radius, "they are disjoint");
    assert!(small.centre.distance(eye) < large.centre.distance(eye), "the small one is nearer by centre");
    assert!(power(eye, large) < power(eye, small), "yet the large one comes first");
    let direction = small.centre.normalize();
    let ((large_in, _), (small_in, _)) = (hit(eye, direction, large).unwrap(), hit(eye, direction, small).unwrap());
    assert!(large_in < small_in, "and rightly, for it is in front on the ray to the other's centre");

    // The same through a scene: two blocks whose balls are these.
    let half = |ball: Sphere| DVec3::splat(2.0 * ball.radius / 3f64.sqrt());
    let plan = vec![
        (0, small.centre, DQuat::IDENTITY, half(small), false),
        (0, large.centre, DQuat::IDENTITY, half(large), false),
    ];
    let scene = build(&plan);
    let wide = view(Tangents { left: -2.0, right: 2.0, bottom: -2.0, top: 2.0 }, Pose::IDENTITY);
    let out = select(&scene, &Entities::new(&scene), &[], Pose::IDENTITY, &wide, None);
    assert_eq!(out.subobjects, [SubobjectId(1), SubobjectId(0)]);
}

#[test]
fn a_branch_outside_is_dropped_without_a_look_inside() {
    let plan: Plan = (0..4096)
        .map(|i| {
            let (x, z) = (f64::from(i % 64) * 10.0, f64::from(i / 64) * 10.0);
            (0, DVec3::new(x, 0.0, -z), DQuat::IDENTITY, DVec3::ONE, false)
        })
        .collect();
    let scene = build(&plan);
    let narrow = view(Tangents { left: -0.05, right: 0.05, bottom: -0.05, top: 0.05 }, Pose::IDENTITY);
    let eye = Pose { position: DVec3::new(-20.0, 0.0, 1.0), orientation: DQuat::IDENTITY };
    let out = select(&scene, &Entities::new(&scene), &[], eye, &narrow, None);
    let counters = out.counters;
    assert_eq!(counters.objects_visible + counters.objects_culled, 4096);
    let asked = counters.branches_tested + counters.objects_tested;
    // A border's blocks are asked whole, 64 objects at a time.
    assert!(asked < 600, "of 4096 objects beside the view {asked} tests were made");
    assert!(counters.branches_outside > 0);
}

#[test]
fn a_moved_object_is_seen_where_it_is_and_not_where_it_was() {
    let plan = vec![
        (0, DVec3::new(0.0, 0.0, -10.0), DQuat::IDENTITY, DVec3::ONE, false),
        (0, DVec3::new(0.0, 0.0, -20.0), DQuat::IDENTITY, DVec3::ONE, false),
    ];
    let scene = build(&plan);
    let mut entities = Entities::new(&scene);
    let ahead = view(Tangents { left: -0.5, right: 0.5, bottom: -0.5, top: 0.5 }, Pose::IDENTITY);
    let select = |entities: &Entities| {
        let out = select(&scene, entities, &[], Pose::IDENTITY, &ahead, None);
        out.subobjects.iter().map(|id| id.0).collect::<Vec<_>>()
    };
    let at = |z: f64| Pose { position: DVec3::new(0.0, 0.0, z), orientation: DQuat::IDENTITY };
    assert_eq!(select(&entities), [0, 1]);
    entities.set(&scene, NodeIndex(0), at(-30.0));
    assert_eq!(select(&entities), [1, 0]);
    entities.set(&scene, NodeIndex(0), at(30.0));
    assert_eq!(select(&entities), [1]);
    entities.unset(&scene, NodeIndex(0));
    assert_eq!(select(&entities), [0, 1]);
}

#[test]
fn an_empty_scene_shows_nothing() {
    let scene = Scene::assemble(Parts::default()).unwrap();
    let ahead = view(Tangents::symmetric(45.0, 640, 360), Pose::IDENTITY);
    let out = select(&scene, &Entities::new(&scene), &[], Pose::IDENTITY, &ahead, None);
    assert_eq!(out, Selection { ends: vec![0], ..Selection::default() });
}

fn vector(range: f64) -> impl Strategy<Value = DVec3> {
    (-range..range, -range..range, -range..range).prop_map(|(x, y, z)| DVec3::new(x, y, z))
}

fn rotation() -> impl Strategy<Value = DQuat> {
    (vector(1.0), 0.01..1.0f64).prop_map(|(v, w)| DQuat::from_xyzw(v.x, v.y, v.z, w).normalize())
}

fn pose(range: f64) -> impl Strategy<Value = Pose> {
    (vector(range), rotation()).prop_map(|(position, orientation)| Pose { position, orientation })
}

fn plan() -> impl Strategy<Value = Plan> {
    let scale = prop_oneof![
        Just(DVec3::ONE),
        vector(3.0),
        (0.1..4.0f64).prop_map(DVec3::splat),
        Just(DVec3::new(-1.0, 1.0, 1.0)),
    ];
    prop::collection::vec((0usize..3, vector(150.0), rotation(), scale, prop::bool::weighted(0.3)), 1..60)
}

fn tangents() -> impl Strategy<Value = Tangents> {
    (-1.5..1.4f64, 0.02..1.5f64, -1.5..1.4f64, 0.02..1.5f64).prop_map(|(left, wide, bottom, high)| Tangents {
        left,
        right: left + wide,
        bottom,
        top: bottom + high,
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    /// The same set as the plain test's, but for what the object as a whole decided better; the same order.
    #[test]
    fn selection_equals_the_plain_test_of_every_subobject(
        plan in plan(), eye in pose(100.0), offset in pose(1.0), tangents in tangents(),
        visibility in prop_oneof![Just(None), (20.0..300.0f64).prop_map(Some)],
        moves in prop::collection::vec((0usize..60, pose(120.0)), 0..6),
    ) {
        let scene = build(&plan);
        let mut entities = Entities::new(&scene);
        for (node, pose) in moves {
            entities.set(&scene, NodeIndex((node % plan.len()) as u32), pose);
        }
        let view = view(tangents, offset);
        let out = select(&scene, &entities, &[], eye, &view, visibility);
        let expected = plain(&scene, &entities, eye, &view, visibility);

        // What the plain test keeps and we don't must be out of sight by the ball or box of its whole object.
        let frustum = Frustum::new(eye, &view, visibility);
        let kept: Vec<_> = expected
            .into_iter()
            .filter(|id| {
                let row = scene.table.subobjects[id.0 as usize];
                let shape = scene.shape_of(scene.object(row.object));
                let transform = entities.transform(&scene, row.object);
                frustum.ball(object_ball(&scene, &entities, row.object)) != Where::Outside
                    && !frustum.misses_box(&transform, shape.bounds)
            })
            .collect();
        prop_assert_eq!(&out.subobjects, &kept);
        let c = out.counters;
        prop_assert_eq!(c.subobjects_visible + c.subobjects_culled, scene.table.subobjects.len() as u64);
        prop_assert_eq!(c.objects_visible + c.objects_culled, scene.objects.len() as u64);
        let mut objects: Vec<_> = kept.iter().map(|id| scene.table.subobjects[id.0 as usize].object).collect();
        objects.sort_unstable();
        objects.dedup();
        prop_assert_eq!(c.objects_visible, objects.len() as u64);
    }

    /// Along no ray from the eye does a ball that is wholly behind another, disjoint one come first in the list.
    #[test]
    fn no_ray_meets_two_disjoint_balls_against_the_lists_order(
        plan in plan(), eye in pose(100.0), directions in prop::collection::vec(vector(1.0), 40),
    ) {
        let scene = build(&plan);
        let all_round = view(Tangents { left: -50.0, right: 50.0, bottom: -50.0, top: 50.0 }, Pose::IDENTITY);
        let out = select(&scene, &Entities::new(&scene), &[], eye, &all_round, None);
        let at_rest = Entities::new(&scene);
        let ball = |id: &SubobjectId| {
            let object = scene.table.subobjects[id.0 as usize].object;
            piece_ball(&scene, &at_rest, object, (id.0 - scene.object(object).first_subobject.0) as usize)
        };
        let balls: Vec<_> = out.subobjects.iter().map(ball).collect();
        for direction in directions.into_iter().filter_map(|d| d.try_normalize()) {
            let hits: Vec<_> = balls.iter().map(|&ball| hit(eye.position, direction, ball)).collect();
            for (i, a) in hits.iter().enumerate() {
                for (j, b) in hits.iter().enumerate().skip(i + 1) {
                    let apart = balls[i].centre.distance(balls[j].centre) > balls[i].radius + balls[j].radius;
                    if let (Some(a), Some(b), true) = (a, b, apart) {
                        prop_assert!(b.1 < 0.0 || a.1 < 0.0 || a.0 <= b.0 + 1e-9, "{i} is behind {j} but comes first");
                    }
                }
            }
        }
    }
}

#[test]
fn versions_without_weight_are_left_out() {
    let mut parts = Parts::default();
    let pieces = PieceSource::plain(split(&block(DVec3::ONE, 1)), 0);
    let shape = parts.add_shape("block", Extras::default(), pieces);
    for version in 0..3u32 {
        parts.nodes.push(NodeSource {
            parent: (version > 0).then_some(0),
            shape,
            levels: if version == 0 { 3 } else { 0 },
            version: Some(version),
            ..NodeSource::default()
        });
    }
    parts.nodes.push(NodeSource { shape, ..NodeSource::default() });
    let scene = Scene::assemble(parts).unwrap();
    let ahead = view(Tangents { left: -1.0, right: 1.0, bottom: -1.0, top: 1.0 }, Pose::IDENTITY);
    let eye = Pose { position: DVec3::Z * 10.0, orientation: DQuat::IDENTITY };
    let mut moved = Entities::new(&scene);
    moved.set(&scene, NodeIndex(0), Pose::IDENTITY);
    for entities in [Entities::new(&scene), moved] {
        for (weights, expected) in
            [(None, vec![0, 3]), (Some([0.0, 0.5, 0.5]), vec![1, 2, 3]), (Some([0.0; 3]), vec![3])]
        {
            let weights: Vec<_> = weights
                .map(|w| VersionWeights { model: proto::ids::ModelId(0), weights: w.to_vec() })
                .into_iter()
                .collect();
            let out = select(&scene, &entities, &weights, eye, &ahead, None);
            // All stand in one place; what was moved there has the smaller ball, for it is not rounded.
            let mut found: Vec<_> = out.subobjects.iter().map(|id| id.0).collect();
            found.sort_unstable();
            assert_eq!(found, expected, "{weights:?}");
            assert_eq!(out.counters.objects_visible, expected.len() as u64, "{weights:?}");
        }
    }
}
