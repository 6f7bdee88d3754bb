//! What a store takes, refuses and answers.

use super::*;
use crate::oracle::{mesh_of, place};
use glam::DVec3;
use proto::piece::PieceKind;

fn id(n: u8) -> ContentId {
    ContentId([n; 16])
}

fn triangle() -> Mesh {
    mesh_of(&[[DVec3::ZERO, DVec3::X, DVec3::Y]], [1.0; 4])
}

#[test]
fn a_mesh_that_contradicts_itself_is_refused_by_name() {
    let refused = |change: fn(&mut Mesh)| {
        let mut mesh = triangle();
        change(&mut mesh);
        let mut store = SceneStore::new();
        let error = store.insert_mesh(id(1), mesh).unwrap_err();
        assert!(!store.holds(&id(1)), "{error}");
        error.to_string()
    };
    let m = "mesh 01010101010101010101010101010101";
    assert_eq!(refused(|m| m.triangles[0][2] = 3), format!("{m}: triangle 0 names vertex 3 of 3"));
    assert_eq!(refused(|m| m.normals.push([0.0; 3])), format!("{m}: 1 normals for 3 positions"));
    assert_eq!(refused(|m| m.colors.push([0.0; 4])), format!("{m}: 1 colours for 3 positions"));
    assert_eq!(refused(|m| m.texcoords.push(vec![])), format!("{m}: 0 texture coordinates for 3 positions"));
    assert_eq!(refused(|m| m.face_numbers.clear()), format!("{m}: 0 face numbers for 1 triangles"));
    assert_eq!(refused(|m| m.positions[1][0] = f32::NAN), format!("{m}: positions has a number that is not finite"));
    assert_eq!(
        refused(|m| m.texcoords = vec![vec![[0.0; 2]; 3]; 3]),
        format!("{m}: 3 texture coordinate sets, allowed are 2")
    );
    assert_eq!(
        refused(|m| {
            m.triangles = vec![[0, 1, 2]; 2049];
            m.face_numbers = vec![0; 2049];
        }),
        format!("{m}: 2049 triangles, allowed are 2048")
    );
}

#[test]
fn meshes_textures_and_tables_come_in_any_order() {
    let mut mesh = triangle();
    mesh.material.base_texture = Some(crate::oracle::texture_use(id(2)));
    let mut store = SceneStore::new();
    let list = [SubobjectId(0), SubobjectId(0), SubobjectId(7)];
    store.set_table(place(&[(id(1), DAffine3::IDENTITY)])).unwrap();
    assert_eq!(store.missing(&list), [id(1)]);
    store.insert_mesh(id(1), mesh).unwrap();
    assert_eq!(store.missing(&list), [id(2)]);
    store.insert_texture(id(2), Texture { width: 1, height: 1, texels: vec![[255; 4]] }).unwrap();
    assert_eq!(store.missing(&list), []);
    assert!(store.holds(&id(1)) && store.holds(&id(2)) && !store.holds(&id(3)), "what came is held");
    assert_eq!(store.contents().collect::<Vec<_>>(), [id(1), id(2)]);
}

#[test]
fn moving_replaces_the_earlier_moves_and_is_checked() {
    let mut store = SceneStore::new();
    store.insert_mesh(id(1), triangle()).unwrap();
    store.set_table(place(&[(id(1), DAffine3::IDENTITY), (id(1), DAffine3::IDENTITY)])).unwrap();
    let there = DAffine3::from_translation(DVec3::X);
    let x = |store: &SceneStore, n| store.find(SubobjectId(n)).unwrap().transform.translation.x;
    store.set_moved(&[Moved { object: ObjectId(0), transform: there }]).unwrap();
    assert_eq!((x(&store, 0), x(&store, 1)), (1.0, 0.0));
    let beyond = Moved { object: ObjectId(2), transform: there };
    assert_eq!(store.set_moved(&[beyond]), Err(StoreError::MovedOutOfRange { object: ObjectId(2), objects: 2 }));
    assert_eq!((x(&store, 0), x(&store, 1)), (1.0, 0.0), "nothing changes on error");
    store.set_moved(&[Moved { object: ObjectId(1), transform: there }]).unwrap();
    assert_eq!((x(&store, 0), x(&store, 1)), (0.0, 1.0));
    let nowhere = DAffine3::from_translation(DVec3::NAN);
    assert_eq!(
        store.set_moved(&[Moved { object: ObjectId(1), transform: nowhere }]),
        Err(StoreError::TransformNotFinite { object: ObjectId(1) })
    );
}

#[test]
fn what_is_given_up_is_missing_again_and_its_memory_is_free() {
    let mut mesh = triangle();
    mesh.material.base_texture = Some(crate::oracle::texture_use(id(2)));
    let texture = || Texture { width: 4, height: 2, texels: vec![[255; 4]; 8] };
    let list = [SubobjectId(0)];
    let mut store = SceneStore::new();
    store.set_table(place(&[(id(1), DAffine3::IDENTITY)])).unwrap();
    store.insert_mesh(id(1), mesh.clone()).unwrap();
    store.insert_texture(id(2), texture()).unwrap();
    let both = store.memory();
    assert_eq!(both, mesh_memory(&mesh) + proto::piece::texture_memory(4, 2));
    store.insert_texture(id(2), texture()).unwrap();
    assert_eq!(store.memory(), both, "what is held already counts once");
    assert!(store.remove(&id(2)) && !store.remove(&id(2)) && !store.remove(&id(7)));
    assert_eq!((store.memory(), store.missing(&list)), (mesh_memory(&mesh), vec![id(2)]));
    assert!(store.remove(&id(1)));
    assert_eq!((store.memory(), store.missing(&list)), (0, vec![id(1)]));
    assert_eq!(store.contents().count(), 0);
    store.insert_texture(id(2), texture()).unwrap();
    store.insert_mesh(id(1), mesh).unwrap();
    assert_eq!((store.memory(), store.missing(&list)), (both, vec![]), "it can come back, in any order");
}

#[test]
fn a_piece_is_what_its_name_says_or_refused() {
    let bytes = proto::codec::encode_mesh(&triangle());
    let (name, other) = (ContentId::of(&bytes), id(9));
    assert!(
        matches!(Prepared::of_piece(other, PieceKind::Mesh, bytes.clone()), Err(PieceError::Name(named)) if named == other)
    );
    assert!(Prepared::of_piece(name, PieceKind::Texture, bytes.clone()).is_err(), "a mesh is no texture");
    let piece = Prepared::of_piece(name, PieceKind::Mesh, bytes).unwrap();
    assert_eq!((piece.id(), piece.memory()), (name, mesh_memory(&triangle())));
}
