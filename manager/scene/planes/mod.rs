//! Faces that lie over each other in one plane: runway markings, posters, the asphalt on the ground.
//!
//! Their order is that of their layers (picture.md, "Coplanar layers"), and no depth arithmetic can find it, since each
//! face's depth comes with a rounding of its own. So such faces are given *one* plane, from which all of them take
//! their depth. This stage finds them at import: pairs of faces that coincide and overlap ([`face`]), joined to groups, each
//! with the plane of its largest face. Neighbours in a finely curved surface nearly coincide, and chained they would
//! flatten it; they are never chained, because neighbours don't overlap.
//!
//! Faces that only touch, where an apron's edge ends within a taxiway's, overlap by slivers once their vertices are
//! rounded; there the layer must decide as well. So groups that touch are given one plane too, but only as far as it is true
//! of all their faces: from the largest face outwards, group by group, as long as all of a group lies in that face's
//! plane. A border that follows a curve ends there, and no group loses a face by it. Neighbours whose border ends
//! in the same corners never need it, nor do faces of one primitive, which continue each other's colours. So a flat net costs
//! nothing, and few faces that stand alone get their depth from another's plane, which differs from their own by the rounding of their
//! outline: as much as what stands on them may move.
//!
//! Faces of one mesh are compared in the mesh's space, once for all objects that show it. Faces of two objects are
//! compared where the file puts them, if both stay there for ever (`static`), in a frame that has the world's axes and one
//! object's origin, so that what coincides does so at any distance from the world's origin. Objects that stand alike
//! get the same map into that frame: what is the same in their meshes is the same there, to the bit. Versions of one model
//! are not compared: they don't hide each other.
//!
//! Cost: n log n for the trees, and the pairs that touch. A limit on pairs keeps heaps of faces in one place from taking
//! for ever; what it leaves out is said.

mod face;
mod tree;

use super::bounds;
use super::database::{Object, Shape};
use face::{Contact, Face, TOLERANCE};
use glam::DAffine3;
use proto::ids::{ContentId, ObjectId};
use proto::scene::{Box3, Mesh, NO_PLANE, PlaneRow, SceneTable};
use rayon::prelude::*;
use std::cell::Cell;
use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use tree::{BoxTree, touch};

/// Most pairs of faces that one mesh, or two objects, may cost: a fraction of a second.
const FACE_PAIRS_MAX: usize = 1 << 26;
/// Most pairs of objects that are looked into.
const OBJECT_PAIRS_MAX: usize = 1 << 22;
/// Most pairs of faces lying over or beside each other that are kept for a mesh or two objects.
const FOUND_MAX: usize = 1 << 22;
/// Most faces that have planes, over all objects: 64 MB of table.
const FACES_MAX: usize = 1 << 24;
/// Faces of a mesh that are made once and not anew for each pair: 180 MB at most.
const FACES_AT_HAND: usize = 1 << 20;
/// How many tolerances a face may be away from the plane of its group's largest.
const GROUP_TOLERANCE: f64 = 4.0;

/// A face of an object: subobject and triangle. In the order of the file.
type Name = (u32, u32);

/// Pairs of faces that are to share a plane.
#[derive(Clone, Debug, Default)]
struct Links {
    /// They lie over each other.
    areas: Vec<(Name, Name)>,
    /// They touch.
    borders: Vec<(Name, Name)>,
}

impl Links {
    fn add(&mut self, contact: Contact, a: Name, b: Name) {
        match contact {
            Contact::Nothing => {}
            Contact::Border => self.borders.push((a, b)),
            Contact::Area => self.areas.push((a, b)),
        }
    }

    fn len(&self) -> usize {
        self.areas.len() + self.borders.len()
    }

    fn append(&mut self, more: &Self, name: impl Fn(Name) -> Name) {
        let named = |&(a, b): &(Name, Name)| (name(a), name(b));
        self.areas.extend(more.areas.iter().map(named));
        self.borders.extend(more.borders.iter().map(named));
    }
}

/// Fills in the planes of `table`, whose objects and subobjects are those of `objects`. `watch` hears how much has been searched, from 0 to
/// 1, on any thread.
pub(super) fn find(
    objects: &[Object],
    shapes: &[Shape],
    meshes: &BTreeMap<ContentId, Arc<Mesh>>,
    table: &mut SceneTable,
    warnings: &mut Vec<String>,
    watch: &(dyn Fn(f64) + Sync),
) {
    let faces = |shape: &Shape| shape.pieces.iter().map(|piece| u64::from(piece.triangles)).sum::<u64>();
    let (done, all) = (AtomicU64::new(0), shapes.iter().map(faces).sum::<u64>().max(1));
    let search = |shape| {
        let searched = Searched::new(shape, meshes);
        let done = done.fetch_add(faces(shape), Ordering::Relaxed) + faces(shape);
        // What is between shapes comes after them, and takes little.
        watch(done as f64 / all as f64);
        searched
    };
    let searched: Vec<Searched<'_>> = shapes.par_iter().map(search).collect();
    let mut search = Search { objects, shapes: searched, table, links: Links::default(), cut_short: false };
    search.within_objects();
    search.between_objects();
    let links = std::mem::take(&mut search.links);
    let cut_short = search.cut_short;
    let (sheets, strays) = search.sheets(groups(links.areas));
    let found = search.planes(&search.with_single_faces(sheets, &strays, &links.borders), &links.borders);
    if !strays.is_empty() {
        warnings.push(format!(
            "{} faces lie close to a plane that others share, but not in it; they keep their own depth",
            strays.len()
        ));
    }
    if cut_short || found.full {
        warnings.push("more faces lie over each other in one plane than are looked for; some may flicker".into());
    }
    enter(found.planes, meshes, table);
}

/// A shape and what is found in it alone.
struct Searched<'a> {
    /// By piece.
    meshes: Vec<&'a Mesh>,
    /// By piece: which primitive it is of.
    primitives: Vec<u32>,
    /// By face: piece and triangle.
    faces: Vec<(u32, u32)>,
    /// Over `faces`.
    tree: BoxTree,
    /// Faces that must share a plane, linked by pairs; pieces and triangles.
    links: Links,
    cut_short: bool,
}

impl<'a> Searched<'a> {
    fn new(shape: &Shape, meshes: &'a BTreeMap<ContentId, Arc<Mesh>>) -> Self {
        let meshes: Vec<&Mesh> =
            shape.pieces.iter().filter_map(|piece| meshes.get(&piece.mesh)).map(Arc::as_ref).collect();
        let primitives = shape.pieces.iter().map(|piece| piece.primitive).collect();
        let mut all = Vec::new();
        let mut boxes = Vec::new();
        let mut faces = Vec::new();
        for (piece, mesh) in meshes.iter().enumerate() {
            for triangle in 0..mesh.triangles.len() {
                if let Some(face) = load(mesh, triangle) {
                    all.push((piece as u32, triangle as u32));
                    boxes.push(face.bounds);
                    if faces.len() < FACES_AT_HAND {
                        faces.push(face);
                    }
                }
            }
        }
        let items = (0..all.len() as u32).collect();
        let tree = BoxTree::build(&boxes, items);
        drop(boxes);
        let mut searched = Self { meshes, primitives, faces: all, tree, links: Links::default(), cut_short: false };
        searched.search(&faces);
        searched
    }

    fn face(&self, item: u32) -> Option<Face> {
        let (piece, triangle) = self.faces[item as usize];
        load(self.meshes[piece as usize], triangle as usize)
    }

    /// Finds the links; `at_hand` are the first of the faces.
    fn search(&mut self, at_hand: &[Face]) {
        let mut links = Links::default();
        let mut pairs = 0;
        let (mut left, mut right) = (Vec::new(), Vec::new());
        let mut cut_short = false;
        self.tree.touching(|a, b, same| {
            let fill = |into: &mut Vec<(u32, Face)>, items: &[u32]| {
                into.clear();
                into.extend(items.iter().filter_map(|&item| {
                    let face = at_hand.get(item as usize).copied().or_else(|| self.face(item));
                    Some((item, face?))
                }));
            };
            fill(&mut left, a);
            fill(&mut right, b);
            for (i, (x, face)) in left.iter().enumerate() {
                for (y, other) in &right[if same { i + 1 } else { 0 }..] {
                    if touch(&face.bounds, &other.bounds) {
                        links.add(face.contact(other), self.faces[*x as usize], self.faces[*y as usize]);
                    }
                }
            }
            pairs += a.len() * b.len();
            cut_short = pairs > FACE_PAIRS_MAX || links.len() > FOUND_MAX;
            !cut_short
        });
        self.cut_short = cut_short;
        // A chain links as well as all pairs do, and is what each object that shows the shape has to copy.
        let groups = groups(links.areas);
        let number = numbers(&groups);
        let is_news = |&(a, b): &(Name, Name)| {
            let primitive = |name: Name| self.primitives[name.0 as usize];
            primitive(a) != primitive(b) && (number(a).is_none() || number(a) != number(b))
        };
        let borders = links.borders.into_iter().filter(is_news).collect();
        let chain = |group: &Vec<Name>| group.windows(2).map(|pair| (pair[0], pair[1])).collect::<Vec<_>>();
        self.links = Links { areas: groups.iter().flat_map(chain).collect(), borders };
    }
}

fn load(mesh: &Mesh, triangle: usize) -> Option<Face> {
    Face::new(mesh.triangles[triangle].map(|vertex| mesh.position(vertex as usize)), mesh.material.double_sided)
}

/// What is connected by links, each group in ascending order, the groups by their first.
fn groups(links: Vec<(Name, Name)>) -> Vec<Vec<Name>> {
    let mut names: Vec<Name> = links.iter().flat_map(|&(a, b)| [a, b]).collect();
    names.sort_unstable();
    names.dedup();
    let index = |name: Name| names.partition_point(|&other| other < name);
    let mut above: Vec<usize> = (0..names.len()).collect();
    fn top(above: &mut [usize], mut at: usize) -> usize {
        while above[at] != at {
            above[at] = above[above[at]];
            at = above[at];
        }
        at
    }
    for (a, b) in links {
        let (a, b) = (top(&mut above, index(a)), top(&mut above, index(b)));
        // The first of a group stays on top, so the order of links doesn't matter.
        above[a.max(b)] = a.min(b);
    }
    let mut groups: BTreeMap<usize, Vec<Name>> = BTreeMap::new();
    for (at, &name) in names.iter().enumerate() {
        groups.entry(top(&mut above, at)).or_default().push(name);
    }
    groups.into_values().collect()
}

/// Which of the lists a face is in.
fn numbers<'a>(lists: impl IntoIterator<Item = &'a Vec<Name>>) -> impl Fn(Name) -> Option<usize> {
    let mut all: Vec<(Name, usize)> =
        lists.into_iter().enumerate().flat_map(|(number, list)| list.iter().map(move |&name| (name, number))).collect();
    all.sort_unstable();
    move |name| all.binary_search_by_key(&name, |entry| entry.0).ok().map(|at| all[at].1)
}

struct Search<'a> {
    objects: &'a [Object],
    shapes: Vec<Searched<'a>>,
    table: &'a SceneTable,
    links: Links,
    cut_short: bool,
}

/// Faces that lie over each other, directly or through others, or a single face.
#[derive(Debug)]
struct Sheet {
    /// The largest.
    leader: Name,
    /// Its area, twice, m².
    area: f64,
    /// All, the leader among them.
    faces: Vec<Name>,
}

/// A plane and the faces in it.
struct Plane {
    row: PlaneRow,
    faces: Vec<Name>,
}

#[derive(Default)]
struct Found {
    planes: Vec<Plane>,
    /// Whether there were more than [`FACES_MAX`].
    full: bool,
}

impl Search<'_> {
    fn shape(&self, object: usize) -> &Searched<'_> {
        &self.shapes[self.objects[object].shape.0 as usize]
    }

    fn within_objects(&mut self) {
        for object in self.objects {
            let shape = &self.shapes[object.shape.0 as usize];
            self.cut_short |= shape.cut_short;
            if self.links.len() + shape.links.len() > FACES_MAX {
                self.cut_short = true;
                return;
            }
            let first = object.first_subobject.0;
            self.links.append(&shape.links, |(piece, triangle)| (first + piece, triangle));
        }
    }

    fn between_objects(&mut self) {
        let boxes: Vec<Box3> = (0..self.objects.len()).map(|object| self.world_box(object)).collect();
        let fixed = |&object: &u32| {
            let object = object as usize;
            self.objects[object].traits.is_static && !self.shape(object).faces.is_empty()
        };
        let tree = BoxTree::build(&boxes, (0..boxes.len() as u32).filter(fixed).collect());
        let mut pairs: Vec<(u32, u32)> = Vec::new();
        tree.touching(|a, b, same| {
            for (i, &x) in a.iter().enumerate() {
                let others = &b[if same { i + 1 } else { 0 }..];
                let near = others.iter().filter(|&&y| touch(&boxes[x as usize], &boxes[y as usize]));
                pairs.extend(near.map(|&y| (x.min(y), x.max(y))));
            }
            pairs.len() < OBJECT_PAIRS_MAX
        });
        pairs.sort_unstable();
        let mut cut_short = pairs.len() >= OBJECT_PAIRS_MAX;
        let found: Vec<(Links, bool)> = pairs.par_iter().map(|&(a, b)| self.between(a as usize, b as usize)).collect();
        let before = self.links.len();
        for (more, limited) in found {
            let is_full = self.links.len() - before + more.len() > FACES_MAX;
            cut_short |= limited || is_full;
            if !is_full {
                self.links.append(&more, |name| name);
            }
        }
        self.cut_short |= cut_short;
    }

    /// Round an object and the tolerance of its faces, world.
    fn world_box(&self, object: usize) -> Box3 {
        let map = self.table.objects[object].transform;
        let bounds = self.shape(object).tree.bounds();
        bounds.map_or(Box3 { min: glam::DVec3::ZERO, max: glam::DVec3::ZERO }, |bounds| {
            let moved = bounds::box_moved(&map, bounds);
            let rounding = moved.min.abs().max(moved.max.abs()).max_element() * 1e-14;
            Box3 { min: moved.min - rounding, max: moved.max + rounding }
        })
    }

    /// Faces of one object that must share a plane with faces of another; and whether there was too much to do.
    fn between(&self, a: usize, b: usize) -> (Links, bool) {
        // The many are asked by the few.
        let (many, few) = if self.shape(a).faces.len() >= self.shape(b).faces.len() { (a, b) } else { (b, a) };
        let (many_shape, few_shape) = (self.shape(many), self.shape(few));
        let frame = Frame::of(self.table, many);
        let (Some(around), Some(back)) = (many_shape.tree.bounds(), frame.back()) else {
            return (Links::default(), false);
        };
        let here = frame.place(self.table, few);
        let there = frame.place(self.table, many);
        let to_many = back * here.0;
        // What rounding on the way to the many's mesh space may amount to.
        let slack = around.min.abs().max(around.max.abs()).max_element() * 1e-12;
        let mut links = Links::default();
        let pairs = Cell::new(0);
        let in_many = |bounds: Box3| {
            let moved = bounds::box_moved(&to_many, bounds);
            Box3 { min: moved.min - slack, max: moved.max + slack }
        };
        let name = |object: usize, (piece, triangle): Name| (self.objects[object].first_subobject.0 + piece, triangle);
        few_shape.tree.leaves(
            |bounds| pairs.get() <= FACE_PAIRS_MAX && touch(&in_many(*bounds), &around),
            |items| {
                for &item in items {
                    let Some(own) = few_shape.face(item) else { continue };
                    let near = in_many(own.bounds);
                    let face = own.moved(&here.0, here.1);
                    many_shape.tree.leaves(
                        |bounds| touch(bounds, &near),
                        |others| {
                            pairs.set(pairs.get() + others.len());
                            for &other in others {
                                let Some(theirs) = many_shape.face(other).filter(|face| touch(&face.bounds, &near))
                                else {
                                    continue;
                                };
                                let x = name(few, few_shape.faces[item as usize]);
                                let y = name(many, many_shape.faces[other as usize]);
                                if self.may_meet(x, y) {
                                    links.add(face.contact(&theirs.moved(&there.0, there.1)), x, y);
                                }
                            }
                        },
                    );
                }
            },
        );
        (links, pairs.get() > FACE_PAIRS_MAX)
    }

    /// Whether two faces are ever compared: not if they are of two versions of one model.
    fn may_meet(&self, a: Name, b: Name) -> bool {
        let part = |name: Name| self.table.subobjects[name.0 as usize].part_of;
        match (part(a), part(b)) {
            (Some(a), Some(b)) => a.model != b.model || a.version == b.version,
            _ => true,
        }
    }

    fn load(&self, name: Name) -> Option<Face> {
        let object = self.table.subobjects[name.0 as usize].object.0 as usize;
        let piece = name.0 - self.objects[object].first_subobject.0;
        load(self.shape(object).meshes[piece as usize], name.1 as usize)
    }

    fn object(&self, name: Name) -> usize {
        self.table.subobjects[name.0 as usize].object.0 as usize
    }

    /// A face where it is in a frame.
    fn placed(&self, frame: &Frame, name: Name) -> Option<Face> {
        let (map, stretch) = frame.place(self.table, self.object(name));
        self.load(name).map(|face| face.moved(&map, stretch))
    }

    /// Whether a face may have the plane of another.
    fn may_follow(&self, frame: &Frame, leader: &Face, name: Name) -> bool {
        self.placed(frame, name)
            .is_some_and(|face| leader.in_plane(&face.corners, GROUP_TOLERANCE * leader.tolerance.max(face.tolerance)))
    }

    /// Each group with its largest face and without those that are too far away from that one's plane; and these.
    fn sheets(&self, groups: Vec<Vec<Name>>) -> (Vec<Sheet>, Vec<Name>) {
        let (mut sheets, mut strays) = (Vec::new(), Vec::new());
        for group in groups {
            let frame = Frame::of(self.table, self.object(group[0]));
            let mut largest: Option<(f64, Name)> = None;
            for &name in &group {
                let area = self.placed(&frame, name).map_or(0.0, |face| face.length);
                if largest.is_none_or(|(most, _)| area > most) {
                    largest = Some((area, name));
                }
            }
            let Some((area, leader)) = largest else { continue };
            let frame = Frame::of(self.table, self.object(leader));
            let Some(lead) = self.placed(&frame, leader) else { continue };
            let mut faces = group;
            faces.retain(|&name| {
                let follows = self.may_follow(&frame, &lead, name);
                if !follows {
                    strays.push(name);
                }
                follows
            });
            sheets.push(Sheet { leader, area, faces });
        }
        (sheets, strays)
    }

    /// The sheets, and one for each face that only touches others.
    fn with_single_faces(&self, mut sheets: Vec<Sheet>, strays: &[Name], borders: &[(Name, Name)]) -> Vec<Sheet> {
        let mut single: Vec<Name> = borders.iter().flat_map(|&(a, b)| [a, b]).collect();
        single.sort_unstable();
        single.dedup();
        // Strays stay what they are: faces with a depth of their own.
        let mut known: Vec<Name> = sheets.iter().flat_map(|sheet| &sheet.faces).chain(strays).copied().collect();
        known.sort_unstable();
        single.retain(|name| known.binary_search(name).is_err());
        sheets.extend(single.into_iter().map(|name| {
            let area = self.placed(&Frame::of(self.table, self.object(name)), name).map_or(0.0, |face| face.length);
            Sheet { leader: name, area, faces: vec![name] }
        }));
        sheets
    }

    /// The planes: of each sheet, largest first, that of its largest face, also for all sheets that touch it, directly or
    /// through others, and lie in it.
    fn planes(&self, sheets: &[Sheet], borders: &[(Name, Name)]) -> Found {
        let number = numbers(sheets.iter().map(|sheet| &sheet.faces));
        let mut beside: Vec<(usize, usize)> = borders
            .iter()
            .filter_map(|&(a, b)| Some((number(a)?, number(b)?)))
            .filter(|(a, b)| a != b)
            .flat_map(|(a, b)| [(a, b), (b, a)])
            .collect();
        beside.sort_unstable();
        beside.dedup();
        let neighbours = |sheet: usize| {
            let from = beside.partition_point(|&(a, _)| a < sheet);
            beside[from..].iter().take_while(move |&&(a, _)| a == sheet).map(|&(_, b)| b)
        };
        let mut order: Vec<usize> = (0..sheets.len()).collect();
        order.sort_by(|&a, &b| sheets[b].area.total_cmp(&sheets[a].area).then(a.cmp(&b)));
        let mut is_taken = vec![false; sheets.len()];
        let mut found = Found::default();
        let (mut total, mut asked) = (0, 0);
        for first in order {
            if std::mem::replace(&mut is_taken[first], true) {
                continue;
            }
            let leader = sheets[first].leader;
            let frame = Frame::of(self.table, self.object(leader));
            let (Some(own), Some(lead)) = (self.load(leader), self.placed(&frame, leader)) else { continue };
            let mut faces = Vec::new();
            let mut open = vec![first];
            while let Some(sheet) = open.pop() {
                faces.extend(&sheets[sheet].faces);
                for next in neighbours(sheet) {
                    if is_taken[next] {
                        continue;
                    }
                    if asked > FACE_PAIRS_MAX {
                        found.full = true;
                        break;
                    }
                    let follows = sheets[next].faces.iter().all(|&name| {
                        asked += 1;
                        self.may_follow(&frame, &lead, name)
                    });
                    if follows {
                        is_taken[next] = true;
                        open.push(next);
                    }
                }
            }
            if faces.len() < 2 {
                continue;
            }
            total += faces.len();
            if total > FACES_MAX {
                found.full = true;
                break;
            }
            let normal = own.normal / own.length;
            let centre = own.corners.iter().sum::<glam::DVec3>() / 3.0;
            let row = PlaneRow { object: ObjectId(self.object(leader) as u32), normal, offset: normal.dot(centre) };
            found.planes.push(Plane { row, faces });
        }
        found
    }
}

/// Where faces of several objects are compared: the world's axes about one object's origin.
struct Frame {
    object: DAffine3,
}

impl Frame {
    fn of(table: &SceneTable, object: usize) -> Self {
        Self { object: table.objects[object].transform }
    }

    /// Mesh space of `object` → the frame, and how much that stretches.
    fn place(&self, table: &SceneTable, object: usize) -> (DAffine3, f64) {
        let map = table.objects[object].transform;
        let map = DAffine3 { matrix3: map.matrix3, translation: map.translation - self.object.translation };
        (map, bounds::stretch(&map))
    }

    /// The frame → mesh space of its object, if there is a way back.
    fn back(&self) -> Option<DAffine3> {
        let inverse = DAffine3::from_mat3(self.object.matrix3).inverse();
        inverse.is_finite().then_some(inverse)
    }
}

/// Writes planes and their faces into the table.
fn enter(planes: Vec<Plane>, meshes: &BTreeMap<ContentId, Arc<Mesh>>, table: &mut SceneTable) {
    for plane in planes {
        let number = table.planes.len() as u32;
        table.planes.push(plane.row);
        for (subobject, triangle) in plane.faces {
            let row = &mut table.subobjects[subobject as usize];
            let count = meshes.get(&row.mesh).map_or(0, |mesh| mesh.triangles.len());
            let start = *row.planes.get_or_insert_with(|| {
                let start = table.face_planes.len();
                table.face_planes.resize(start + count, NO_PLANE);
                start as u32
            });
            table.face_planes[start as usize + triangle as usize] = number;
        }
    }
}

const _: () = assert!(TOLERANCE * GROUP_TOLERANCE < 1e-5, "a plane must not visibly bend what lies in it");

#[cfg(test)]
mod tests;
