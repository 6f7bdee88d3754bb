//! Damaged files and hostile ones: each is refused with a sentence that names the file and the section.
//!
//! Damage is found by checksums. A hostile file has right checksums and wrong content; [`Forged`] makes such, so that what is behind the
//! checksums is tested too.

use super::*;
use crate::scene::Content;
use crate::scene::baked::file::{self, Section};
use crate::scene::baked::rows::{BranchRow, ContentRow, MaterialRow, NodeRow, PieceRow, PlaneRow, ShapeRow};
use crate::scene::baked::{FORMAT, check_all};
use bytemuck::Pod;
use proto::ids::ContentId;
use proto::limits;

/// The refusal of a file.
#[track_caller]
fn refusal(bytes: &[u8]) -> String {
    open(bytes).expect_err("must be refused").to_string()
}

/// What is wrong with a file whose tables are right: refused at the first mesh or texture that is damaged.
fn use_all(bytes: &[u8]) -> Result<(), String> {
    let scene = open_bytes(bytes.to_vec(), "city.baked").map_err(|error| error.to_string())?;
    check_all(&scene).map_err(|error| error.to_string())
}

/// A file whose sections can be changed, and which then gets checksums that fit.
struct Forged {
    sections: Vec<Vec<u8>>,
}

impl Forged {
    fn small() -> Self {
        Self::of(small_file())
    }

    fn of(bytes: &[u8]) -> Self {
        let index = |at: usize, word: usize| {
            let at = 64 + 64 * at + 8 + 8 * word;
            u64::from_le_bytes(bytes[at..at + 8].try_into().unwrap()) as usize
        };
        let section = |at: usize| bytes[index(at, 0)..index(at, 0) + index(at, 1)].to_vec();
        Self { sections: (0..Section::all().count()).map(section).collect() }
    }

    fn bytes(&self) -> Vec<u8> {
        let mut bytes = vec![0; file::SECTIONS_BEGIN];
        let mut entries = Vec::new();
        for (section, content) in Section::all().zip(&self.sections) {
            bytes.resize(bytes.len().next_multiple_of(64), 0);
            let checksum = *blake3::hash(content).as_bytes();
            entries.push(file::entry(section, bytes.len() as u64, content.len() as u64, checksum).unwrap());
            bytes.extend(content);
        }
        let head = file::head(&entries, bytes.len() as u64);
        bytes[..head.len()].copy_from_slice(&head);
        bytes
    }

    fn rows<T: Pod>(&self, section: Section) -> Vec<T> {
        self.sections[section as usize].chunks_exact(size_of::<T>()).map(bytemuck::pod_read_unaligned).collect()
    }

    /// Changes a section's rows.
    fn change<T: Pod>(mut self, section: Section, change: impl FnOnce(&mut Vec<T>)) -> Self {
        let mut rows = self.rows(section);
        change(&mut rows);
        self.sections[section as usize] = bytemuck::cast_slice(&rows).to_vec();
        self
    }

    /// Changes a number of 32 bits at byte `at` of a row.
    fn word<T>(mut self, section: Section, row: usize, at: usize, value: u32) -> Self {
        let at = row * size_of::<T>() + at;
        self.sections[section as usize][at..at + 4].copy_from_slice(&value.to_le_bytes());
        self
    }

    /// Changes a number of 64 bits.
    fn double<T>(mut self, section: Section, row: usize, at: usize, value: f64) -> Self {
        let at = row * size_of::<T>() + at;
        self.sections[section as usize][at..at + 8].copy_from_slice(&value.to_le_bytes());
        self
    }

    #[track_caller]
    fn refused(self, parts: &[&str]) {
        let text = refusal(&self.bytes());
        for part in parts {
            assert!(text.contains(part), "{part:?} is not in: {text}");
        }
    }
}

#[test]
fn a_forged_file_without_a_change_is_the_file() {
    assert!(Forged::small().bytes() == small_file());
}

#[test]
fn an_empty_file_and_one_of_another_kind() {
    for bytes in [&b""[..], b"glTF", b"{\"asset\": {\"version\": \"2.0\"}}", &[0; 5000]] {
        assert!(matches!(open(bytes), Err(BakedFault::NotBaked)), "{bytes:?}");
    }
}

#[test]
fn a_folder_a_missing_file_and_a_device() {
    let folder = tempfile::tempdir().unwrap();
    let fault = |path: &std::path::Path| *super::super::open(path).unwrap_err().fault;
    assert!(matches!(fault(folder.path()), BakedFault::NotAFile));
    assert!(matches!(fault("/dev/zero".as_ref()), BakedFault::NotAFile));
    assert!(matches!(fault(&folder.path().join("none")), BakedFault::Io { .. }));
    let path = folder.path().join("empty.baked");
    std::fs::write(&path, "").unwrap();
    assert!(matches!(fault(&path), BakedFault::NotBaked), "an empty file can't be mapped, yet is answered");
    assert!(!super::super::is_baked(&path) && !super::super::is_baked(folder.path()));
}

#[test]
fn every_way_to_cut_a_file_short() {
    let bytes = small_file();
    for length in 0..bytes.len() {
        let fault = open(&bytes[..length]).expect_err("a part of a file");
        let fits = if length == 0 {
            matches!(fault, BakedFault::NotBaked)
        } else {
            matches!(fault, BakedFault::Length { has, .. } if has == length as u64)
        };
        assert!(fits, "{length} bytes: {fault}");
    }
}

#[test]
fn a_file_with_something_behind_it() {
    let mut bytes = small_file().to_vec();
    bytes.push(0);
    assert!(refusal(&bytes).contains("bytes long"));
}

/// A flipped bit gives an error, or, between two sections, the same scene.
#[test]
fn no_flipped_bit_is_ever_believed() {
    let good = small_file();
    let original = use_all_described(good);
    let forged = Forged::small();
    let mut bytes = good.to_vec();
    let mut padding = 0;
    for at in 0..good.len() {
        for bit in [0, 6] {
            bytes[at] = good[at] ^ 1 << bit;
            match use_all(&bytes) {
                Err(text) => assert!(text.starts_with("city.baked: "), "byte {at}: {text}"),
                Ok(()) => {
                    assert_eq!(use_all_described(&bytes), original, "byte {at}");
                    padding += 1;
                }
            }
        }
        bytes[at] = good[at];
    }
    let used: usize = file::SECTIONS_BEGIN + forged.sections.iter().map(Vec::len).sum::<usize>();
    assert_eq!(padding, 2 * (good.len() - used), "only what is between sections may be anything");
}

fn use_all_described(bytes: &[u8]) -> String {
    let scene = open(bytes).unwrap();
    format!("{:?} {:?} {:?} {:?}", scene.nodes, scene.table, scene.blocks.tree, scene.meshes.all().unwrap())
}

#[test]
fn damage_is_named_by_its_section() {
    let good = small_file();
    for (at, section) in Section::all().enumerate() {
        let entry = 64 + 64 * at + 8;
        let [offset, length] =
            [0, 8].map(|word| u64::from_le_bytes(good[entry + word..entry + word + 8].try_into().unwrap()) as usize);
        assert!(length > 0, "the small scene has {}", section.name());
        for place in [offset, offset + length - 1] {
            let mut bytes = good.to_vec();
            bytes[place] ^= 0x10;
            let text = use_all(&bytes).unwrap_err();
            assert!(text.starts_with(&format!("city.baked: section {}: ", section.name())), "{text}");
            if !section.is_payload() {
                let checksum = format!("city.baked: section {}: damaged", section.name());
                assert!(refusal(&bytes).contains(&checksum["city.baked: ".len()..]), "at opening");
            }
        }
    }
}

#[test]
fn versions_and_byte_orders() {
    let mut bytes = small_file().to_vec();
    bytes[12..16].copy_from_slice(&(FORMAT + 1).to_le_bytes());
    let text = refusal(&bytes);
    assert!(text.contains(&format!("format version {}, this program reads {FORMAT}", FORMAT + 1)), "{text}");
    let mut bytes = small_file().to_vec();
    bytes[8..12].reverse();
    assert!(matches!(open(&bytes), Err(BakedFault::Endianness)));
}

/// Writes a header and index that a checksum vouches for.
fn with_index(change: impl FnOnce(&mut [u64])) -> String {
    let mut bytes = small_file().to_vec();
    let mut index: Vec<u64> =
        bytes[64..file::SECTIONS_BEGIN].chunks_exact(8).map(bytemuck::pod_read_unaligned).collect();
    change(&mut index);
    bytes[64..file::SECTIONS_BEGIN].copy_from_slice(bytemuck::cast_slice(&index));
    let mut hasher = blake3::Hasher::new();
    hasher.update(&bytes[..32]).update(&bytes[64..file::SECTIONS_BEGIN]);
    bytes[32..64].copy_from_slice(hasher.finalize().as_bytes());
    refusal(&bytes)
}

/// Words of an entry of the index.
const OFFSET: usize = 1;
const LENGTH: usize = 2;
const ROWS: usize = 3;

#[test]
fn an_index_that_contradicts_itself() {
    let at = |section: Section, word: usize| section as usize * 8 + word;
    let overlapping = with_index(|index| index[at(Section::Shapes, OFFSET)] -= 64);
    assert!(overlapping.contains("section shapes: the index says that it begins at byte"), "{overlapping}");
    let beyond = with_index(|index| index[at(Section::TextureIndex, OFFSET)] += 64);
    assert!(beyond.contains("section texture index"), "{beyond}");
    let long = with_index(|index| {
        index[at(Section::Meshes, LENGTH)] += 1 << 32;
        index[at(Section::Meshes, ROWS)] += 1 << 32;
    });
    assert!(long.contains("section meshes: the index says that it ends beyond the file's"), "{long}");
    let ragged = with_index(|index| index[at(Section::Nodes, LENGTH)] -= 1);
    assert!(ragged.contains("section nodes: the index says that"), "{ragged}");
    let overflow = with_index(|index| index[at(Section::Meshes, ROWS)] = u64::MAX);
    assert!(overflow.contains("section meshes: 18446744073709551615 rows, at most"), "{overflow}");
    let swapped = with_index(|index| index[at(Section::Pieces, 0)] = index[at(Section::Nodes, 0)]);
    assert!(swapped.contains("section pieces: the index says that it is section 0"), "{swapped}");
    let short = with_index(|index| {
        index[at(Section::TextureIndex, LENGTH)] = 0;
        index[at(Section::TextureIndex, ROWS)] = 0;
    });
    assert!(short.contains("section texture index") && short.contains("nothing follows"), "{short}");
}

#[test]
fn counts_beyond_their_limits_are_refused_before_anything_is_reserved() {
    for (section, limit) in [
        (Section::Nodes, limits::NODES_MAX),
        (Section::Shapes, limits::OBJECTS_MAX),
        (Section::Pieces, limits::SUBOBJECTS_MAX),
        (Section::Lights, limits::LIGHTS_MAX),
        (Section::Text, limits::TEXT_MAX),
    ] {
        let text = with_index(|index| index[section as usize * 8 + ROWS] = limit as u64 + 1);
        assert!(
            text.contains(&format!("section {}: {} rows, at most {limit} are", section.name(), limit + 1)),
            "{text}"
        );
    }
}

/// Where numbers stand in their rows.
const PARENT: usize = 152;
const SHAPE: usize = 156;
const LIGHT: usize = 160;
const LEVELS: usize = 164;
const VERSION: usize = 168;

#[test]
fn nodes_that_make_no_tree() {
    let node = |row, at, value| Forged::small().word::<NodeRow>(Section::Nodes, row, at, value);
    node(0, PARENT, 0).refused(&["section nodes, row 0: its parent is Some(0), which is not above"]);
    node(0, PARENT, 5).refused(&["section nodes, row 0"]);
    node(4, PARENT, 2).refused(&["section nodes, row 4: its parent is Some(2), which is not above"]);
}

#[test]
fn nodes_that_name_what_there_is_not() {
    let node = |row, at, value| Forged::small().word::<NodeRow>(Section::Nodes, row, at, value);
    node(1, SHAPE, 3).refused(&["section nodes, row 1: shape 3, there are 3"]);
    node(2, LIGHT, 1).refused(&["section nodes, row 2: light 1, the next is 0"]);
    node(0, LIGHT, 0).refused(&["section nodes, row 2: light 0, the next is 1"]);
    node(5, VERSION, 2).refused(&["section nodes, row 5: version 2 of 2"]);
    node(5, VERSION, 40).refused(&["section nodes, row 5: version 40 of 2"]);
    node(3, LEVELS, 1000).refused(&["1000 levels of detail of one model"]);
    node(6, LEVELS, 2).refused(&["is merged"]);
}

#[test]
fn numbers_that_are_none() {
    let node = |at, value| Forged::small().double::<NodeRow>(Section::Nodes, 4, at, value);
    node(0, f64::NAN).refused(&["node \"fine\" lies beyond"]);
    node(72, f64::INFINITY).refused(&["node \"fine\" lies beyond"]);
    node(96, f64::NAN).refused(&["section nodes, row 4: the rotation"]);
    node(96, 7.0).refused(&["section nodes, row 4: the rotation"]);
    for (at, value) in [(0, f64::NAN), (24, -1.0), (24, f64::INFINITY), (32, 1e9), (56, f64::NAN)] {
        let shape = Forged::small().double::<ShapeRow>(Section::Shapes, 1, at, value);
        shape.refused(&["section shapes, row 1: "]);
        Forged::small().double::<PieceRow>(Section::Pieces, 2, at, value).refused(&["section pieces, row 2: "]);
    }
    Forged::small().double::<BranchRow>(Section::Branches, 1, 24, f64::NAN).refused(&["section branches, row 1: "]);
    Forged::small().double::<PlaneRow>(Section::Planes, 0, 8, f64::NAN).refused(&["section planes, row 0: "]);
    let light = Forged::small().double::<super::super::rows::LightRow>(Section::Lights, 1, 16, -3.0);
    light.refused(&["section lights, row 1: a light's range of -3 m"]);
    let nan = f32::NAN.to_bits();
    Forged::small().word::<MaterialRow>(Section::Materials, 2, 0, nan).refused(&["section materials, row 2: the base"]);
}

#[test]
fn flags_and_modes_of_another_version() {
    Forged::small().word::<NodeRow>(Section::Nodes, 0, 148, 3).refused(&["section nodes, row 0: unknown flags 0x3"]);
    Forged::small().word::<NodeRow>(Section::Nodes, 0, 148, 1 << 11).refused(&["unknown flags 0x800"]);
    Forged::small().word::<PieceRow>(Section::Pieces, 0, 96, 4).refused(&["section pieces, row 0: unknown flags"]);
    Forged::small().word::<MaterialRow>(Section::Materials, 0, 104, 3).refused(&["unknown alpha mode"]);
    Forged::small().word::<MaterialRow>(Section::Materials, 0, 108, 4).refused(&["unknown flags"]);
    Forged::small().word::<MaterialRow>(Section::Materials, 0, 64, 3).refused(&["unknown ways to read a texture"]);
}

#[test]
fn shapes_pieces_and_materials_that_name_what_there_is_not() {
    let piece = |at, value| Forged::small().word::<PieceRow>(Section::Pieces, 1, at, value);
    piece(80, 77).refused(&["section pieces, row 1: mesh 77, there are"]);
    piece(84, 3).refused(&["section pieces, row 1: material 3, there are 3"]);
    piece(88, u32::MAX).refused(&["section pieces, row 1: a primitive without number"]);
    piece(88, 9).refused(&["section pieces, row 2: primitives don't ascend"]);
    let last = Forged::small().rows::<PieceRow>(Section::Pieces).len() - 1;
    let many = Forged::small().word::<PieceRow>(Section::Pieces, last, 88, u32::MAX - 1);
    many.refused(&["primitives, at most 4294967295 are possible"]);
    let shape = |at, value| Forged::small().word::<ShapeRow>(Section::Shapes, 0, at, value);
    shape(104, 0).refused(&["section shapes, row 0: 0 pieces"]);
    shape(104, 1000).refused(&["section shapes, row 0: 1000 pieces"]);
    shape(104, 1).refused(&["section"]);
    shape(108, 5000).refused(&["section branches, row 0: 5000 branches"]);
    shape(112, u32::MAX).refused(&["section branches, row 0:"]);
    let texture = Forged::small().word::<MaterialRow>(Section::Materials, 0, 32, 1);
    texture.refused(&["section materials, row 0: texture 1, there are 1"]);
}

#[test]
fn culling_trees_that_lead_astray() {
    let last = Forged::small().rows::<BranchRow>(Section::Branches).len() - 1;
    let branch = |at, value| Forged::small().word::<BranchRow>(Section::Branches, last, at, value);
    branch(32, 7).refused(&["section branches, row"]);
    branch(36, 70).refused(&["its items are not among those"]);
    branch(40, 0).refused(&["its subtree doesn't end"]);
    branch(40, 1000).refused(&["its subtree doesn't end"]);
    Forged::small()
        .change(Section::Items, |items: &mut Vec<u32>| items[0] = 900)
        .refused(&["section items, row 0: item 900"]);
    Forged::small().change(Section::Items, |items: &mut Vec<u32>| items[1] = items[0]).refused(&["is there twice"]);
    Forged::small()
        .change(Section::Branches, |all: &mut Vec<BranchRow>| all.truncate(last))
        .refused(&["section branches"]);
}

#[test]
fn names_out_of_order_missing_or_twice() {
    let names = |change: fn(&mut Vec<u32>)| Forged::small().change(Section::Names, change);
    names(|names| names.swap(0, 1)).refused(&["section names, row 1: node", "is not in order"]);
    names(|names| names[1] = names[0]).refused(&["section names, row 1"]);
    names(|names| names[0] = 2).refused(&["section names, row 0: node 2 is not in order"]);
    names(|names| names[0] = 99).refused(&["section names, row 0: node 99, there are 9"]);
    names(|names| {
        names.pop();
    })
    .refused(&["section names, row 7: 8 nodes have a name"]);
}

#[test]
fn texts_that_are_too_long_too_few_or_no_text() {
    let lengths = |change: fn(&mut Vec<u32>)| Forged::small().change(Section::Lengths, change);
    lengths(|lengths| lengths[1] = u32::MAX).refused(&["section lengths, row 1: 4294967295 bytes of text"]);
    lengths(|lengths| lengths[1] -= 1).refused(&["section lengths"]);
    lengths(|lengths| lengths.truncate(4)).refused(&["fewer texts than things"]);
    Forged::small()
        .change(Section::Text, |text: &mut Vec<u8>| text[1] = 0xff)
        .refused(&["row 0: its text is not UTF-8"]);
    Forged::small()
        .change(Section::Text, |text: &mut Vec<u8>| text.push(b'x'))
        .refused(&["1 bytes of text are nobody's"]);
}

#[test]
fn planes_of_faces_that_there_are_not() {
    Forged::small().word::<PlaneRow>(Section::Planes, 0, 32, 6).refused(&["section planes, row 0: object 6"]);
    let faces = |change: fn(&mut Vec<u32>)| Forged::small().change(Section::FacePlanes, change);
    faces(|faces| faces[0] = 4000).refused(&["section face planes, row 0: plane 4000"]);
    faces(|faces| {
        faces.pop();
    })
    .refused(&["section subobject planes, row", "faces begin at"]);
    let begins = |change: fn(&mut Vec<u32>)| Forged::small().change(Section::SubobjectPlanes, change);
    begins(|begins| begins[0] = u32::MAX - 1).refused(&["section subobject planes, row 0"]);
    begins(|begins| {
        begins.pop();
    })
    .refused(&["section subobject planes, row", "subobjects"]);
}

#[test]
fn contents_that_leave_their_section_or_its_order() {
    let index = |change: fn(&mut Vec<ContentRow>)| Forged::small().change(Section::MeshIndex, change);
    index(|rows| rows.swap(0, 1)).refused(&["section mesh index, row 1: names don't ascend"]);
    index(|rows| rows[1] = rows[0]).refused(&["names don't ascend"]);
    index(|rows| rows[0].length = u32::MAX).refused(&["section mesh index, row 0: 4294967295 bytes, at most"]);
    index(|rows| rows[0].length = 1 << 20).refused(&["section mesh index, row 0: 1048576 bytes,", "are left"]);
    index(|rows| rows[0].length -= 1).refused(&["bytes of payload are nobody's"]);
    index(|rows| rows[0].size[1] = 1 << 30).refused(&["section pieces, row", "its mesh has 1073741824 triangles"]);
}

/// A mesh that is what its name says, in a file with all checksums right, and yet can't be drawn.
#[test]
fn a_mesh_with_a_corner_too_many_is_refused_when_it_is_used() {
    let corners = |last| {
        let positions = vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
        let mut mesh = split(&Primitive { positions, triangles: vec![[0, 1, 2]], ..Primitive::default() }).remove(0);
        mesh.triangles[0][2] = last;
        mesh
    };
    let mut parts = Parts { materials: small().materials, ..Parts::default() };
    parts.materials.drain(..2);
    let shape = parts.add_shape("", Extras::default(), PieceSource::plain(vec![corners(2)], 0));
    parts.nodes = vec![NodeSource { shape, ..NodeSource::default() }];
    let forged = |mesh: Mesh| {
        let mut forged = Forged::of(&bake(&parts));
        let payload = mesh.encode();
        forged.sections[Section::Meshes as usize] = payload.to_vec();
        forged.change(Section::MeshIndex, |rows: &mut Vec<ContentRow>| rows[0].id = ContentId::of(&payload).0).bytes()
    };
    use_all(&forged(corners(2))).unwrap();
    let text = use_all(&forged(corners(3))).unwrap_err();
    assert!(text.contains("section meshes: mesh") && text.contains("a triangle has the corner 3"), "{text}");
    let mut far = corners(2);
    far.positions[1][1] = f32::NAN;
    let text = use_all(&forged(far)).unwrap_err();
    assert!(text.contains("a position is not finite"), "{text}");
    let text = use_all(&forged(Mesh { triangles: Vec::new(), face_numbers: Vec::new(), ..corners(2) }));
    assert!(text.unwrap_err().contains("section mesh index"), "another length");
}

#[test]
fn a_file_that_is_changed_while_it_is_open() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("city.baked");
    let bytes = small_file();
    let opened = || {
        std::fs::write(&path, bytes).unwrap();
        super::super::open(&path).unwrap()
    };
    let change = |bytes: &[u8]| {
        let file = std::fs::OpenOptions::new().write(true).open(&path).unwrap();
        file.set_len(bytes.len() as u64).unwrap();
        std::os::unix::fs::FileExt::write_all_at(&file, bytes, 0).unwrap();
    };
    let refused = |scene: &Scene| check_all(scene).unwrap_err().to_string();

    let scene = opened();
    change(&[bytes, b"more"].concat());
    assert!(refused(&scene).contains("was changed while in use"), "it grows");

    let scene = opened();
    change(&bytes[..bytes.len() / 2]);
    assert!(refused(&scene).contains("was changed while in use"), "it shrinks");

    let scene = opened();
    change(&vec![7; bytes.len()]);
    assert!(refused(&scene).contains("its content has another name"), "other bytes, as many");

    // As bake does it: another file takes the name, and who has the old one open keeps it.
    let scene = opened();
    let other = folder.path().join("other");
    std::fs::write(&other, "another file").unwrap();
    std::fs::rename(&other, &path).unwrap();
    check_all(&scene).unwrap();
}
