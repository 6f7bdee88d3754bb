//! Typed reading of the file's binary data.
//!
//! An accessor says "count elements of this type, this far apart, from this byte of that buffer view", and every one of
//! these numbers is outside input. So reading has two steps: [`Data::layout`] proves, in arithmetic that can't wrap, that
//! the last byte is there, before a single byte is reserved; then elements are fetched through a slice of exactly
//! the proven range. A file can't make us reserve more than a fixed multiple of its own size: strides of less than an
//! element are refused, and accessors without data (all zero but for a sparse part) have their own limit.

use super::error::Fault;
use gltf::json::accessor::{Accessor, ComponentType, GenericComponentType, IndexComponentType, Type};
use gltf::json::validation::Checked;
use gltf::json::{Index, Root};
use std::borrow::Cow;

/// Most elements of an accessor that has no data of its own: 16 MiB of 4-component vectors.
const ELEMENTS_WITHOUT_DATA_MAX: u64 = 1 << 20;

/// The document and its buffers.
#[derive(Debug)]
pub(super) struct Data<'a> {
    /// The JSON part.
    pub(super) root: &'a Root,
    /// Each at least as long as it is declared.
    pub(super) buffers: Vec<Cow<'a, [u8]>>,
}

/// Elements of a proven range.
#[derive(Clone, Copy)]
struct Layout<'a> {
    bytes: &'a [u8],
    stride: usize,
    component: ComponentType,
}

fn size_of(component: ComponentType) -> usize {
    match component {
        ComponentType::I8 | ComponentType::U8 => 1,
        ComponentType::I16 | ComponentType::U16 => 2,
        ComponentType::U32 | ComponentType::F32 => 4,
    }
}

fn width_of(kind: Type) -> usize {
    match kind {
        Type::Scalar => 1,
        Type::Vec2 => 2,
        Type::Vec3 => 3,
        Type::Vec4 | Type::Mat2 => 4,
        Type::Mat3 => 9,
        Type::Mat4 => 16,
    }
}

/// Which accessor is read for whom: what messages need.
#[derive(Clone, Copy, Debug)]
pub(super) struct For<'a> {
    /// `node "tower"`.
    pub(super) place: &'a str,
    /// Index of the accessor.
    pub(super) accessor: usize,
}

impl For<'_> {
    fn wrong(self, what: impl Into<String>) -> Fault {
        Fault::Accessor { place: self.place.into(), accessor: self.accessor, what: what.into() }
    }
}

impl<'a> Data<'a> {
    /// The bytes of a buffer view.
    pub(super) fn view(&self, view: usize, place: &str) -> Result<&[u8], Fault> {
        let described = at(&self.root.buffer_views, view, "buffer view", place)?;
        let number = described.buffer.value();
        let buffer = at(&self.buffers, number, "buffer", place)?;
        let start = described.byte_offset.map_or(0, |offset| offset.0);
        let end = start.checked_add(described.byte_length.0);
        end.and_then(|end| buffer.get(usize::try_from(start).ok()?..usize::try_from(end).ok()?)).ok_or_else(|| {
            Fault::OutOfBounds {
                place: place.into(),
                what: format!("buffer view {view}"),
                needs: end.unwrap_or(u64::MAX),
                whole: format!("buffer {number}"),
                has: buffer.len() as u64,
            }
        })
    }

    fn accessor(&self, who: For<'_>) -> Result<&'a Accessor, Fault> {
        at(&self.root.accessors, who.accessor, "accessor", who.place)
    }

    /// Proves that `count` elements lie in the view.
    fn layout(
        &self,
        who: For<'_>,
        view: Index<gltf::json::buffer::View>,
        offset: u64,
        count: u64,
        (component, width): (ComponentType, usize),
    ) -> Result<Layout<'_>, Fault> {
        let bytes = self.view(view.value(), who.place)?;
        let size = size_of(component) * width;
        let declared = self.root.buffer_views.get(view.value()).and_then(|view| view.byte_stride);
        let stride = declared.map_or(size, |stride| if stride.0 == 0 { size } else { stride.0 });
        if stride < size {
            return Err(who.wrong(format!("has elements of {size} bytes only {stride} bytes apart")));
        }
        let span = match count.checked_sub(1) {
            None => Some(0),
            Some(before) => before.checked_mul(stride as u64).and_then(|bytes| bytes.checked_add(size as u64)),
        };
        let end = span.and_then(|span| offset.checked_add(span));
        let range = end.and_then(|end| Some(usize::try_from(offset).ok()?..usize::try_from(end).ok()?));
        let bytes = range.and_then(|range| bytes.get(range)).ok_or_else(|| Fault::OutOfBounds {
            place: who.place.into(),
            what: format!("accessor {} ({count} elements)", who.accessor),
            needs: end.unwrap_or(u64::MAX),
            whole: format!("buffer view {}", view.value()),
            has: bytes.len() as u64,
        })?;
        Ok(Layout { bytes, stride, component })
    }

    /// The type of an accessor: components per element, and whether they are integers that are not normalised.
    pub(super) fn shape(&self, who: For<'_>) -> Result<(usize, bool), Fault> {
        let accessor = self.accessor(who)?;
        let (component, kind) = checked(accessor, who)?;
        Ok((width_of(kind), component != ComponentType::F32 && !accessor.normalized))
    }

    /// Vectors of N numbers. Normalised integers become 0..=1 or −1..=1, others their value. Refuses what is not
    /// finite.
    pub(super) fn vectors<const N: usize>(&self, who: For<'_>) -> Result<Vec<[f32; N]>, Fault> {
        let all = self.vectors_raw(who)?;
        let broken = all.iter().position(|vector| vector.iter().any(|number| !number.is_finite()));
        match broken {
            None => Ok(all),
            Some(element) => Err(Fault::NotFinite {
                place: who.place.into(),
                accessor: who.accessor,
                element,
                value: if all[element].iter().any(|number| number.is_nan()) { "a NaN" } else { "an infinity" },
            }),
        }
    }

    /// [`Data::vectors`], but whatever the numbers are.
    pub(super) fn vectors_raw<const N: usize>(&self, who: For<'_>) -> Result<Vec<[f32; N]>, Fault> {
        let accessor = self.accessor(who)?;
        let (component, kind) = checked(accessor, who)?;
        // Matrices of small integers have padding inside; nothing that is read here is a matrix.
        if width_of(kind) != N || matches!(kind, Type::Mat2 | Type::Mat3 | Type::Mat4) {
            return Err(who.wrong(format!("is {kind:?}, but vectors of {N} are needed here")));
        }
        if component == ComponentType::U32 {
            return Err(who.wrong("has 32-bit integers, which only indices may have"));
        }
        let normalized = accessor.normalized;
        self.elements(accessor, who, component, N, [0.0; N], |layout, i| layout.vector(i, normalized))
    }

    /// Vertex indices.
    pub(super) fn indices(&self, who: For<'_>) -> Result<Vec<u32>, Fault> {
        let accessor = self.accessor(who)?;
        let (component, kind) = checked(accessor, who)?;
        let unsigned = matches!(component, ComponentType::U8 | ComponentType::U16 | ComponentType::U32);
        if kind != Type::Scalar || !unsigned {
            return Err(who.wrong(format!("is {kind:?} of {component:?}, but indices are unsigned scalars")));
        }
        self.elements(accessor, who, component, 1, 0, |layout, i| layout.index(i))
    }

    /// All elements of an accessor: those of its view, or zeros, with the sparse ones put in their places.
    fn elements<T: Copy>(
        &self,
        accessor: &Accessor,
        who: For<'_>,
        component: ComponentType,
        width: usize,
        zero: T,
        fetch: impl Fn(Layout<'_>, usize) -> T,
    ) -> Result<Vec<T>, Fault> {
        let count = accessor.count.0;
        let mut all: Vec<T> = match accessor.buffer_view {
            Some(view) => {
                let offset = accessor.byte_offset.map_or(0, |offset| offset.0);
                let layout = self.layout(who, view, offset, count, (component, width))?;
                (0..count as usize).map(|i| fetch(layout, i)).collect()
            }
            None if count <= ELEMENTS_WITHOUT_DATA_MAX => vec![zero; count as usize],
            None => {
                let limit = ELEMENTS_WITHOUT_DATA_MAX;
                return Err(who.wrong(format!("has {count} elements and no data, at most {limit} are possible")));
            }
        };
        if let Some(sparse) = &accessor.sparse {
            let Checked::Valid(IndexComponentType(index_type)) = sparse.indices.component_type else {
                return Err(who.wrong("has sparse indices of an unknown type"));
            };
            let (places, values) = (&sparse.indices, &sparse.values);
            let n = sparse.count.0;
            let from = self.layout(who, places.buffer_view, places.byte_offset.0, n, (index_type, 1))?;
            let values = self.layout(who, values.buffer_view, values.byte_offset.0, n, (component, width))?;
            for i in 0..n as usize {
                let place = from.index(i);
                match all.get_mut(place as usize) {
                    Some(element) => *element = fetch(values, i),
                    None => return Err(who.wrong(format!("replaces element {place} of {count}"))),
                }
            }
        }
        Ok(all)
    }
}

impl Layout<'_> {
    fn take<const B: usize>(&self, at: usize) -> [u8; B] {
        let mut out = [0; B];
        out.copy_from_slice(&self.bytes[at..at + B]);
        out
    }

    fn vector<const N: usize>(&self, element: usize, normalized: bool) -> [f32; N] {
        let size = size_of(self.component);
        std::array::from_fn(|i| {
            let at = element * self.stride + i * size;
            // Divisors and the lower bound: glTF 2.0, 3.6.2.2 (accessor data types).
            let (value, divisor) = match self.component {
                ComponentType::F32 => return f32::from_le_bytes(self.take(at)),
                ComponentType::I8 => (f32::from(i8::from_le_bytes(self.take(at))), 127.0),
                ComponentType::U8 => (f32::from(self.bytes[at]), 255.0),
                ComponentType::I16 => (f32::from(i16::from_le_bytes(self.take(at))), 32767.0),
                ComponentType::U16 => (f32::from(u16::from_le_bytes(self.take(at))), 65535.0),
                ComponentType::U32 => (u32::from_le_bytes(self.take(at)) as f32, u32::MAX as f32),
            };
            if normalized { (value / divisor).max(-1.0) } else { value }
        })
    }

    fn index(&self, element: usize) -> u32 {
        let at = element * self.stride;
        match self.component {
            ComponentType::U8 | ComponentType::I8 => u32::from(self.bytes[at]),
            ComponentType::U16 | ComponentType::I16 => u32::from(u16::from_le_bytes(self.take(at))),
            ComponentType::U32 | ComponentType::F32 => u32::from_le_bytes(self.take(at)),
        }
    }
}

fn checked(accessor: &Accessor, who: For<'_>) -> Result<(ComponentType, Type), Fault> {
    match (accessor.component_type, accessor.type_) {
        (Checked::Valid(GenericComponentType(component)), Checked::Valid(kind)) => Ok((component, kind)),
        _ => Err(who.wrong("is of an unknown type")),
    }
}

/// The element of a list that an index means.
pub(super) fn at<'b, T>(list: &'b [T], index: usize, what: &'static str, place: &str) -> Result<&'b T, Fault> {
    list.get(index).ok_or_else(|| Fault::Dangling { place: place.into(), what, index, count: list.len() })
}
