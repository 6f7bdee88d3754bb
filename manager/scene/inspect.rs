//! What is in a scene, for a person or as JSON: `cyclorama inspect`.
//!
//! Triangles are counted twice over: *stored*, each mesh of the file once, and *drawn*, each as often as a node shows
//! it. The tree is abbreviated, because nobody reads ten thousand lines: of many brothers the first few are shown, and
//! what is left out is counted.

use super::baked::Facts;
use super::{NodeIndex, Scene};
use proto::ids::ContentId;
use proto::scene::{Alpha, Box3, Sphere};
use serde::Serialize;
use std::collections::BTreeMap;
use std::fmt;

/// Brothers that are shown before the rest is only counted.
const BROTHERS: usize = 12;
/// Most nodes that are shown in all.
const NODES_SHOWN: usize = 200;

/// The description of a scene.
#[derive(Clone, Debug, Serialize)]
pub struct Inspection {
    /// Its name.
    pub name: String,
    /// Counts of everything.
    pub counts: Counts,
    /// How many materials have each alpha mode.
    pub materials: Materials,
    /// The textures, largest first.
    pub textures: Vec<TextureLine>,
    /// The box round everything, world, m; none for an empty scene.
    pub bounds: Option<Box3>,
    /// A ball round everything, world, m; none for an empty scene.
    pub sphere: Option<Sphere>,
    /// The beginning of the tree, depth-first.
    pub tree: Vec<TreeLine>,
    /// What the importer left out or mended.
    pub warnings: Vec<String>,
    /// The file it is in, if that is a baked one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub baked: Option<Facts>,
}

/// How many there are.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Counts {
    /// Nodes that the scene reaches, instances included.
    pub nodes: usize,
    /// Levels of nodes.
    pub depth: usize,
    /// Nodes that carry a mesh.
    pub objects: usize,
    /// Meshes of the file that are shown.
    pub meshes: usize,
    /// Pieces of them, each kept once.
    pub pieces: usize,
    /// Pieces as often as they are drawn.
    pub subobjects: usize,
    /// Triangles, each mesh counted once.
    pub triangles_stored: u64,
    /// Triangles as often as they are drawn.
    pub triangles_drawn: u64,
    /// Vertices of the pieces; those on a cut count once for each side.
    pub vertices: u64,
    /// Textures.
    pub textures: usize,
    /// Bytes of all textures' texels.
    pub texture_bytes: u64,
}

/// Materials that are shown, by what their alpha means.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Materials {
    /// Alpha is ignored.
    pub opaque: usize,
    /// Alpha cuts out.
    pub mask: usize,
    /// Alpha is saturation.
    pub blend: usize,
}

/// A texture.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct TextureLine {
    /// Its name by content.
    pub id: String,
    /// Width in texels.
    pub width: u32,
    /// Height in texels.
    pub height: u32,
}

/// A node, or a gap in the tree.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct TreeLine {
    /// 0 for a root.
    pub depth: usize,
    /// The node's name, `(node 12)` if it has none.
    pub name: String,
    /// Its mesh, if it carries one.
    pub mesh: Option<String>,
    /// Triangles that it and all below draw.
    pub triangles: u64,
    /// If not 0, this line stands for so many brothers that are not shown; it has no name.
    pub left_out: usize,
}

/// Describes a scene.
pub fn inspect(scene: &Scene) -> Inspection {
    let shape_triangles: Vec<u64> =
        scene.shapes.iter().map(|shape| shape.pieces.iter().map(|piece| u64::from(piece.triangles)).sum()).collect();
    // Sum over a range of objects by difference.
    let mut drawn = vec![0u64];
    for object in &scene.objects {
        drawn.push(drawn[drawn.len() - 1] + shape_triangles[object.shape.0 as usize]);
    }
    let mut depths: Vec<usize> = Vec::with_capacity(scene.nodes.len());
    for node in &scene.nodes {
        depths.push(node.parent.map_or(0, |parent| depths[parent.0 as usize] + 1));
    }
    let pieces: BTreeMap<ContentId, u64> = scene
        .shapes
        .iter()
        .flat_map(|shape| &shape.pieces)
        .map(|piece| (piece.mesh, u64::from(piece.vertices)))
        .collect();

    let mut materials = Materials::default();
    for entry in &scene.materials {
        match entry.material.alpha {
            Alpha::Opaque => materials.opaque += 1,
            Alpha::Mask { .. } => materials.mask += 1,
            Alpha::Blend => materials.blend += 1,
        }
    }
    let mut textures: Vec<TextureLine> =
        scene.textures.sizes().map(|(id, [width, height])| TextureLine { id: id.to_string(), width, height }).collect();
    textures.sort_by_key(|line| std::cmp::Reverse(u64::from(line.width) * u64::from(line.height)));

    let mut tree = Vec::new();
    write_tree(scene, &depths, &drawn, &mut tree);
    Inspection {
        name: scene.name.clone(),
        counts: Counts {
            nodes: scene.nodes.len(),
            depth: depths.iter().map(|depth| depth + 1).max().unwrap_or(0),
            objects: scene.objects.len(),
            meshes: scene.shapes.len(),
            pieces: pieces.len(),
            subobjects: scene.table.subobjects.len(),
            triangles_stored: shape_triangles.iter().sum(),
            triangles_drawn: drawn[drawn.len() - 1],
            vertices: pieces.values().sum(),
            textures: textures.len(),
            texture_bytes: textures.iter().map(|line| u64::from(line.width) * u64::from(line.height) * 4).sum(),
        },
        materials,
        textures,
        bounds: scene.bounds,
        sphere: Some(scene.sphere).filter(|sphere| sphere.radius >= 0.0),
        tree,
        warnings: scene.warnings.clone(),
        baked: None,
    }
}

// Depth-first with an own stack: a chain of nodes may be longer than the thread's stack.
fn write_tree(scene: &Scene, depths: &[usize], drawn: &[u64], out: &mut Vec<TreeLine>) {
    enum Todo {
        Node(NodeIndex),
        Gap { depth: usize, count: usize },
    }
    let push = |open: &mut Vec<Todo>, depth: usize, brothers: Vec<NodeIndex>| {
        // One line more is no longer than the line that says one was left out.
        let shown = if brothers.len() <= BROTHERS + 1 { brothers.len() } else { BROTHERS };
        if shown < brothers.len() {
            open.push(Todo::Gap { depth, count: brothers.len() - shown });
        }
        open.extend(brothers[..shown].iter().rev().map(|&node| Todo::Node(node)));
    };
    let mut open = Vec::new();
    push(&mut open, 0, scene.roots.clone());
    while let Some(todo) = open.pop() {
        match todo {
            Todo::Gap { depth, count } => {
                out.push(TreeLine { depth, name: String::new(), mesh: None, triangles: 0, left_out: count });
            }
            Todo::Node(index) if out.len() < NODES_SHOWN => {
                let node = scene.node(index);
                let mesh = node.object.map(|object| scene.shape_of(scene.object(object)).name.clone());
                out.push(TreeLine {
                    depth: depths[index.0 as usize],
                    name: if node.name.is_empty() { format!("(node {})", index.0) } else { node.name.clone() },
                    mesh,
                    triangles: drawn[node.objects.end as usize] - drawn[node.objects.start as usize],
                    left_out: 0,
                });
                push(&mut open, depths[index.0 as usize] + 1, scene.children(index).collect());
            }
            Todo::Node(index) => {
                let count = (scene.node(index).end - index.0) as usize;
                match out.last_mut().filter(|line| line.left_out > 0) {
                    Some(line) => line.left_out += count,
                    None => {
                        out.push(TreeLine { depth: 0, name: String::new(), mesh: None, triangles: 0, left_out: count });
                    }
                }
            }
        }
    }
}

impl fmt::Display for Inspection {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let c = &self.counts;
        writeln!(f, "{}", self.name)?;
        writeln!(f, "  nodes       {} in {} levels, {} with a mesh", c.nodes, c.depth, c.objects)?;
        writeln!(f, "  meshes      {} in {} pieces, drawn as {} subobjects", c.meshes, c.pieces, c.subobjects)?;
        writeln!(f, "  triangles   {} stored, {} drawn", c.triangles_stored, c.triangles_drawn)?;
        writeln!(f, "  vertices    {}", c.vertices)?;
        let m = &self.materials;
        writeln!(f, "  materials   {} opaque, {} mask, {} blend", m.opaque, m.mask, m.blend)?;
        write!(f, "  textures    {}", c.textures)?;
        if c.textures > 0 {
            let sizes: Vec<String> =
                self.textures.iter().take(8).map(|t| format!("{}×{}", t.width, t.height)).collect();
            let more = if c.textures > 8 { ", …" } else { "" };
            write!(f, " of {:.1} MiB: {}{more}", c.texture_bytes as f64 / (1 << 20) as f64, sizes.join(", "))?;
        }
        writeln!(f)?;
        match (self.bounds, self.sphere) {
            (Some(b), Some(s)) => {
                let (size, at) = (b.max - b.min, s.centre);
                writeln!(
                    f,
                    "  bounds      {:.3} × {:.3} × {:.3} m, from ({:.3}, {:.3}, {:.3})",
                    size.x, size.y, size.z, b.min.x, b.min.y, b.min.z
                )?;
                writeln!(f, "  sphere      radius {:.3} m about ({:.3}, {:.3}, {:.3})", s.radius, at.x, at.y, at.z)?;
            }
            _ => writeln!(f, "  bounds      none: nothing is drawn")?,
        }
        if !self.tree.is_empty() {
            writeln!(f, "tree")?;
        }
        for line in &self.tree {
            let indent = "  ".repeat(line.depth + 1);
            if line.left_out > 0 {
                writeln!(f, "{indent}… {} more", line.left_out)?;
                continue;
            }
            write!(f, "{indent}{}", line.name)?;
            match &line.mesh {
                Some(mesh) if !mesh.is_empty() && *mesh != line.name => write!(f, " [{mesh}]")?,
                Some(_) => write!(f, " [mesh]")?,
                None => {}
            }
            if line.triangles > 0 { writeln!(f, "  {} triangles", line.triangles)? } else { writeln!(f)? }
        }
        for warning in &self.warnings {
            writeln!(f, "warning: {warning}")?;
        }
        if let Some(facts) = &self.baked {
            write!(f, "{facts}")?;
        }
        Ok(())
    }
}
