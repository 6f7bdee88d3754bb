//! Faces that take their depth from a plane of the scene.
//!
//! The ground is 1 m below the eye. What is seen at y pixels lies at Y = 1 − y/4 of the view's frame, times w, so that
//! 1/w = y/4 − 1, and the horizon is at y = 4.

use super::*;
use crate::depth::InverseDepth;
use crate::plane::ScenePlane;
use crate::screen::Screen;
use crate::{Grid, Options, Vertices, WorldError, points, sample};
use proto::frame::Moved;
use proto::ids::{ContentId, ObjectId, SubobjectId};
use proto::scene::{NO_PLANE, ObjectRow, PlaneRow, SceneTable, SubobjectRow};
use std::collections::BTreeMap;
use std::sync::Arc;

const ROUNDED: Vertices = Vertices::Rounded(Grid::PIPELINE);

/// A rectangle on the ground between two columns and two rows of the screen.
fn on_ground(left: f64, right: f64, far: f64, near: f64) -> [DVec3; 6] {
    let point = |x: f64, y: f64| on_screen(x, y, 1.0 / (y / 4.0 - 1.0));
    quad([point(left, near), point(right, near), point(right, far), point(left, far)])
}

fn ground(offset: f64) -> ScenePlane {
    ScenePlane { transform: DAffine3::IDENTITY, normal: DVec3::Y, offset }
}

/// All faces of these meshes take their depth from the ground.
fn grounded(meshes: &[Mesh]) -> World<'_> {
    let mut world = world(meshes);
    world.planes = vec![ground(-1.0)];
    for instance in &mut world.instances {
        instance.planes = vec![Some(0); instance.mesh.triangles.len()];
    }
    world
}

#[test]
fn faces_of_one_plane_have_its_depth_to_the_bit_whatever_their_corners() {
    let meshes = [
        mesh(&on_ground(0.377, 7.901, 4.213, 7.7), paint([1.0; 3])),
        mesh(&on_ground(1.913, 6.101, 4.907, 6.3), paint([0.5; 3])),
    ];
    let world = grounded(&meshes);
    for vertices in [ROUNDED, Vertices::Exact] {
        let screen = Screen::new(&world, &state([0.0; 3]), &view(), vertices);
        assert_eq!(screen.pieces.len(), 4);
        for point in points::grid(16).map(|[x, y]| [x * 8.0, y * 8.0]) {
            let depths: Vec<f64> = screen.pieces.iter().map(|piece| piece.inverse_depth(point)).collect();
            assert!((depths[0] - (point[1] / 4.0 - 1.0)).abs() < 1e-15, "{point:?}: {depths:?}");
            assert!(depths.iter().all(|depth| depth.to_bits() == depths[0].to_bits()), "{point:?}: {depths:?}");
        }
    }
    // Through rounded corners it is up to half a step of the grid aside.
    let own = world.without_planes();
    let screen = Screen::new(&own, &state([0.0; 3]), &view(), ROUNDED);
    let error = |piece: &crate::screen::Piece| (piece.inverse_depth([4.0, 6.0]) - 0.5).abs();
    let worst = screen.pieces.iter().map(error).fold(0.0, f64::max);
    assert!(worst > 1e-6 && worst < 0.5 / 256.0, "{worst}");
}

#[test]
fn a_wall_on_the_ground_begins_where_it_stands() {
    // It goes through the ground at y = 6.4. The ground's own corners are rounded half a step of the grid down.
    let meshes = [
        mesh(&on_ground(-0.3, 8.9, 4.213, 7.713), paint([1.0, 0.0, 0.0])),
        mesh(&rectangle(0.1, 5.1, 3.3, 7.1, 1.0 / 0.6), paint([0.0, 0.0, 1.0])),
    ];
    let mut world = grounded(&meshes);
    world.instances[1].planes.clear();
    let own = world.without_planes();
    let aside = 0.3 / 256.0;
    for (y, is_wall, is_wall_by_corners) in [(0.4 - aside, true, true), (0.4 + aside, false, true)] {
        let options = Options::like(ROUNDED, &[[0.5, y]]);
        for (world, is_wall) in [(&world, is_wall), (&own, is_wall_by_corners)] {
            let want = if is_wall { [0.0, 0.0, 1.0] } else { [1.0, 0.0, 0.0] };
            assert_close(sample(world, &state([0.0; 3]), &view(), &options).at(2, 6), want, 0.0);
        }
    }
}

#[test]
fn what_a_rounded_outline_shows_beyond_the_horizon_is_infinitely_far() {
    // At 10⁵ m the ground ends 4e-5 pixels below the horizon, on the grid at the horizon itself.
    let mut meshes = [mesh(&on_ground(1.0, 7.0, 4.00004, 6.0), paint([1.0; 3]))];
    meshes[0].colors = vec![[1.0, 0.5, 0.25, 1.0]; 6];
    let world = grounded(&meshes);
    let screen = Screen::new(&world, &state([0.0; 3]), &view(), ROUNDED);
    let place = crate::shade::Place { piece: &screen.pieces[1], point: [2.0, 3.99] };
    assert_eq!(screen.distance(place), f64::INFINITY);
    for visibility_m in [None, Some(50.0)] {
        let mut state = state([0.0; 3]);
        state.environment.visibility_m = visibility_m;
        let picture = sample(&world, &state, &view(), &Options::like(ROUNDED, &[[0.5, 0.0], [0.5, 0.5]]));
        assert!(picture.linear.iter().flatten().all(|c| c.is_finite()), "{picture:?}");
        // Half the points of row 4 lie on the horizon.
        let far = picture.at(3, 4);
        match visibility_m {
            None => assert_close(far, [1.0, 0.5, 0.25], 1e-12),
            Some(_) => assert!(far[0] > 0.2 && far[0] < 0.5, "{far:?}"),
        }
    }
}

#[test]
fn a_plane_seen_edge_on_is_of_no_use() {
    // 1/w rises by 1/(4 h) per pixel; at the near plane, 0.1 m, it is 10: one step of 1/256 pixel for h = 1/10 240.
    let camera = crate::camera::Camera::new(&state([0.0; 3]), &view());
    let is_used = |height: f64, vertices| InverseDepth::of_scene_plane(&camera, &ground(-height), vertices).is_some();
    for (height, want) in [(0.0, false), (0.9 / 10_240.0, false), (1.1 / 10_240.0, true), (1.0, true)] {
        assert_eq!(is_used(height, ROUNDED), want, "{height} m");
        assert_eq!(is_used(-height, ROUNDED), want, "{height} m above");
    }
    assert!(is_used(1e-9, Vertices::Exact) && !is_used(0.0, Vertices::Exact));
}

/// Two objects on the ground, the second's faces in the plane of the first.
fn scene() -> (SceneTable, BTreeMap<ContentId, Arc<Mesh>>) {
    let id = ContentId([1; 16]);
    let meshes = BTreeMap::from([(id, Arc::new(mesh(&on_ground(1.0, 7.0, 5.0, 7.0), paint([1.0; 3]))))]);
    let row = |object: u32| SubobjectRow {
        object: ObjectId(object),
        mesh: id,
        primitive: object,
        layer: 0,
        part_of: None,
        planes: Some(2 * object),
    };
    let table = SceneTable {
        objects: vec![ObjectRow { transform: DAffine3::IDENTITY }; 2],
        subobjects: vec![row(0), row(1)],
        planes: vec![PlaneRow { object: ObjectId(0), normal: DVec3::Y, offset: -1.0 }],
        face_planes: vec![0, 0, NO_PLANE, 0],
        ..SceneTable::default()
    };
    (table, meshes)
}

#[test]
fn a_plane_holds_while_nothing_moves_or_what_moves_is_one_object() {
    let (table, meshes) = scene();
    let planes = |moved: &[(u32, f64)]| {
        let moved: Vec<Moved> = moved
            .iter()
            .map(|(object, up)| Moved {
                object: ObjectId(*object),
                transform: DAffine3::from_translation(DVec3::Y * *up),
            })
            .collect();
        let textures = BTreeMap::new();
        let world = World::of_scene(&table, &meshes, &textures, &moved, &[]).unwrap();
        [world.instances[0].planes.clone(), world.instances[1].planes.clone()]
    };
    let (both, second, none) = (vec![Some(0); 2], vec![None, Some(0)], vec![None; 2]);
    assert_eq!(planes(&[]), [both.clone(), second.clone()]);
    assert_eq!(planes(&[(0, 0.0), (1, 0.0)]), [both.clone(), second], "moved to where they are");
    assert_eq!(planes(&[(0, 0.5)]), [both.clone(), none.clone()]);
    assert_eq!(planes(&[(1, 0.5)]), [both.clone(), none.clone()]);
    assert_eq!(planes(&[(0, 0.5), (1, 0.5)]), [both, none]);
}

#[test]
fn a_face_that_does_not_lie_in_its_plane_is_refused() {
    let (table, meshes) = scene();
    let refused = |change: &dyn Fn(&mut SceneTable)| {
        let mut table = table.clone();
        change(&mut table);
        World::of_scene(&table, &meshes, &BTreeMap::new(), &[], &[]).err()
    };
    let wrong = |subobject, triangle| Some(WorldError::Plane { subobject: SubobjectId(subobject), triangle });
    assert_eq!(refused(&|_| {}), None);
    assert_eq!(refused(&|t| t.planes[0].offset = -1.000_01), None, "4 m away, 4e-5 m are allowed");
    assert_eq!(refused(&|t| t.planes[0].offset = -1.001), wrong(0, 0));
    assert_eq!(refused(&|t| t.planes[0].normal = DVec3::new(0.6, 0.8, 0.0)), wrong(0, 0));
    let up = |t: &mut SceneTable, by| t.objects[1].transform.translation.y = by;
    assert_eq!(refused(&|t| up(t, 1e-5)), None);
    assert_eq!(refused(&|t| up(t, 0.001)), wrong(1, 1));
    assert_eq!(refused(&|t| t.face_planes[3] = 7), wrong(1, 1));
    assert_eq!(refused(&|t| t.face_planes.truncate(3)), wrong(1, 1));
    assert_eq!(refused(&|t| t.planes[0].object = ObjectId(2)), Some(WorldError::PlaneObject { plane: 0 }));
}
