//! Reads accessors: every offset, count and component type is checked against the available bytes.

use super::container::Asset;
use crate::import::warnings::Warnings;
use gltf::json::accessor::{ComponentType, Type, VALID_ACCESSOR_TYPES, sparse::Sparse};
use gltf::json::validation::{Checked, USize64};
use gltf::json::{Accessor, Index, buffer};
use std::cell::Cell;

/// The value at the start of `bytes`; normalised integers by the rules of glTF 2.0, section 3.6.2.2.
fn read_f32(component: ComponentType, bytes: &[u8], normalized: bool) -> Option<f32> {
    let signed = |v: f32, max: f32| if normalized { (v / max).max(-1.0) } else { v };
    let unsigned = |v: f32, max: f32| if normalized { v / max } else { v };
    Some(match component {
        ComponentType::I8 => signed(f32::from(i8::from_le_bytes(*bytes.first_chunk()?)), 127.0),
        ComponentType::U8 => unsigned(f32::from(*bytes.first()?), 255.0),
        ComponentType::I16 => signed(f32::from(i16::from_le_bytes(*bytes.first_chunk()?)), 32767.0),
        ComponentType::U16 => unsigned(f32::from(u16::from_le_bytes(*bytes.first_chunk()?)), 65535.0),
        ComponentType::U32 => u32::from_le_bytes(*bytes.first_chunk()?) as f32,
        ComponentType::F32 => f32::from_le_bytes(*bytes.first_chunk()?),
    })
}

fn read_u32(component: ComponentType, bytes: &[u8]) -> Option<u32> {
    match component {
        ComponentType::U8 => bytes.first().map(|b| u32::from(*b)),
        ComponentType::U16 => bytes.first_chunk().map(|b| u32::from(u16::from_le_bytes(*b))),
        ComponentType::U32 => bytes.first_chunk().map(|b| u32::from_le_bytes(*b)),
        ComponentType::I8 | ComponentType::I16 | ComponentType::F32 => None,
    }
}

/// The name of an accessor's type: `VEC3`.
fn name_of(kind: Type) -> &'static str {
    // The variants are numbered from 1, in the order of the names.
    VALID_ACCESSOR_TYPES.get((kind as usize).wrapping_sub(1)).copied().unwrap_or_default()
}

/// As an index or a count. A value beyond the address space is out of every range.
fn whole(value: USize64) -> usize {
    usize::try_from(value.0).unwrap_or(usize::MAX)
}

fn offset(value: Option<USize64>) -> usize {
    value.map_or(0, whole)
}

/// Reads accessors of one asset. Its error messages contain the problem, without the place.
pub(super) struct Accessors<'a> {
    asset: &'a Asset,
    /// Maximum number of elements of an accessor without data: zeros need no bytes in the file.
    most_zeros: u64,
    /// Remaining bytes that may be read. Many primitives that each read one large buffer would take too long.
    allowance: Cell<u64>,
}

/// An accessor whose extent has been checked.
struct View<'a> {
    /// From the first element on; empty if the accessor has no data of its own.
    bytes: &'a [u8],
    stride: usize,
    component: ComponentType,
    kind: Type,
    components: usize,
    normalized: bool,
    count: usize,
}

/// The storage types of an attribute that are allowed beside 32-bit floats.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Stored {
    /// As floats, or as integers of 8 or 16 bits, normalised or not (KHR_mesh_quantization).
    Quantized,
    /// As floats, or as normalised integers of 8 or 16 bits.
    Normalized,
    /// As floats only.
    Float,
}

impl<'a> Accessors<'a> {
    const WORK: u64 = 16 << 30;

    pub(super) fn new(asset: &'a Asset) -> Self {
        Self { asset, most_zeros: (1 << 20) + asset.buffer_bytes(), allowance: Cell::new(Self::WORK) }
    }

    /// The bytes of a buffer view.
    pub(super) fn view_bytes(&self, index: usize) -> Result<&'a [u8], String> {
        let view = self.buffer_view(index)?;
        let bytes = self.asset.buffer(view.buffer.value()).ok_or_else(|| {
            if view.extensions.as_ref().is_some_and(|e| e.others.contains_key("EXT_meshopt_compression")) {
                format!("buffer view {index} is compressed by EXT_meshopt_compression, which is not supported")
            } else if self.asset.document.root.get(view.buffer).is_some() {
                format!("buffer {} has no data", view.buffer)
            } else {
                format!("buffer {} does not exist", view.buffer)
            }
        })?;
        let (start, length) = (offset(view.byte_offset), whole(view.byte_length));
        start.checked_add(length).and_then(|end| bytes.get(start..end)).ok_or_else(|| {
            format!("buffer view {index} (offset {start}, length {length}) exceeds its buffer of {} bytes", bytes.len())
        })
    }

    /// The element count of an accessor, unchecked against its data.
    pub(super) fn count(&self, index: usize) -> Option<usize> {
        self.asset.document.root.accessors.get(index).map(|a| whole(a.count))
    }

    /// Reads vectors of `N` floats. Accessors with fewer components are refused, except that three-component colours
    /// come with the fill value 1 in the fourth.
    pub(super) fn vectors<const N: usize>(&self, index: usize, stored: Stored) -> Result<Vec<[f32; N]>, String> {
        let accessor = self.accessor(index)?;
        let view = self.resolve(index, accessor)?;
        let fits = view.components == N || (N == 4 && view.components == 3 && stored == Stored::Normalized);
        if !fits {
            return Err(format!("accessor {index} is {}, where {N} components belong", name_of(view.kind)));
        }
        let allowed = match view.component {
            ComponentType::F32 => true,
            ComponentType::U32 => false,
            _ => stored == Stored::Quantized || (stored == Stored::Normalized && view.normalized),
        };
        if !allowed {
            return Err(format!("accessor {index} has the component type {}", view.component.as_gl_enum()));
        }
        let element = |bytes: &[u8]| -> Option<[f32; N]> {
            let mut value = [1.0; N];
            for (i, v) in value.iter_mut().take(view.components).enumerate() {
                *v = read_f32(view.component, bytes.get(i * view.component.size()..)?, view.normalized)?;
            }
            Some(value)
        };
        self.elements(index, &view, accessor.sparse.as_ref(), [0.0; N], element)
    }

    /// Reads unsigned whole numbers: vertex indices (`N` = 1) or joints (`N` = 4).
    pub(super) fn whole<const N: usize>(&self, index: usize) -> Result<Vec<[u32; N]>, String> {
        let accessor = self.accessor(index)?;
        let view = self.resolve(index, accessor)?;
        if view.components != N {
            return Err(format!("accessor {index} is {}, where {N} components belong", name_of(view.kind)));
        }
        if !matches!(view.component, ComponentType::U8 | ComponentType::U16 | ComponentType::U32) {
            return Err(format!("accessor {index} holds no unsigned whole numbers"));
        }
        let element = |bytes: &[u8]| -> Option<[u32; N]> {
            let mut value = [0; N];
            for (i, v) in value.iter_mut().enumerate() {
                *v = read_u32(view.component, bytes.get(i * view.component.size()..)?)?;
            }
            Some(value)
        };
        self.elements(index, &view, accessor.sparse.as_ref(), [0; N], element)
    }

    /// All elements, after the replacements of a sparse accessor; `zero` where there is no data.
    fn elements<T: Copy>(
        &self,
        index: usize,
        view: &View<'_>,
        sparse: Option<&Sparse>,
        zero: T,
        element: impl Fn(&[u8]) -> Option<T>,
    ) -> Result<Vec<T>, String> {
        let mut values = Vec::with_capacity(view.count);
        if view.bytes.is_empty() {
            values.resize(view.count, zero);
        } else {
            for i in 0..view.count {
                values.push(view.bytes.get(i * view.stride..).and_then(&element).ok_or("the data ends too early")?);
            }
        }
        if let Some(sparse) = sparse {
            let size = view.component.size() * view.components;
            self.for_sparse(index, sparse, view.count, size, |i, bytes| {
                if let (Some(slot), Some(value)) = (values.get_mut(i), element(bytes)) {
                    *slot = value;
                }
            })?;
        }
        Ok(values)
    }

    /// Warns of invalid alignment. The data is read nevertheless.
    pub(super) fn warn_alignment(&self, index: usize, warnings: &mut Warnings) {
        let Ok(accessor) = self.accessor(index) else { return };
        let Checked::Valid(component) = accessor.component_type else { return };
        let Some(view) = accessor.buffer_view.and_then(|v| self.asset.document.root.get(v)) else { return };
        let size = component.0.size();
        let stride = view.byte_stride.map_or(0, |s| s.0);
        if !(offset(accessor.byte_offset).wrapping_add(offset(view.byte_offset))).is_multiple_of(size)
            || !stride.is_multiple_of(size)
        {
            warnings.push(format!("accessor {index}"), "the data is not aligned to its component size");
        }
    }

    fn accessor(&self, index: usize) -> Result<&'a Accessor, String> {
        self.asset.document.root.accessors.get(index).ok_or_else(|| format!("accessor {index} does not exist"))
    }

    fn buffer_view(&self, index: usize) -> Result<&'a buffer::View, String> {
        self.asset.document.root.buffer_views.get(index).ok_or_else(|| format!("buffer view {index} does not exist"))
    }

    fn resolve(&self, index: usize, accessor: &Accessor) -> Result<View<'a>, String> {
        let Checked::Valid(component) = accessor.component_type else {
            return Err(format!("accessor {index} has a component type that does not exist"));
        };
        let component = component.0;
        let kind = match accessor.type_ {
            Checked::Valid(kind @ (Type::Scalar | Type::Vec2 | Type::Vec3 | Type::Vec4)) => kind,
            // Columns of small components are padded to 4 bytes. Only float matrices are used here.
            Checked::Valid(kind @ Type::Mat4) if component == ComponentType::F32 => kind,
            Checked::Valid(other) => return Err(format!("accessor {index} has the type \"{}\"", name_of(other))),
            Checked::Invalid => return Err(format!("accessor {index} has a type that does not exist")),
        };
        let components = kind.multiplicity();
        let size = component.size() * components;
        let count = whole(accessor.count);
        if count == 0 {
            return Err(format!("accessor {index} is empty"));
        }
        self.spend(accessor.count.0.saturating_mul(size as u64))?;
        let normalized = accessor.normalized;
        let view = View { bytes: &[], stride: size, component, kind, components, normalized, count };
        let Some(buffer_view) = accessor.buffer_view else {
            if accessor.count.0 > self.most_zeros {
                return Err(format!("accessor {index} has {count} elements but no data"));
            }
            return Ok(view);
        };
        let bytes = self.view_bytes(buffer_view.value())?;
        let stride = match self.buffer_view(buffer_view.value())?.byte_stride.map(|s| s.0) {
            None | Some(0) => size,
            Some(stride) if stride >= size => stride,
            Some(stride) => return Err(format!("accessor {index}: stride {stride} is less than the element's {size}")),
        };
        let offset = offset(accessor.byte_offset);
        let end = (count - 1).checked_mul(stride).and_then(|n| n.checked_add(size)).and_then(|n| n.checked_add(offset));
        if end.is_none_or(|end| end > bytes.len()) {
            return Err(format!(
                "accessor {index} ({count} elements of {size} bytes, stride {stride}, offset {offset}) exceeds its \
                 buffer view of {} bytes",
                bytes.len()
            ));
        }
        Ok(View { bytes: bytes.get(offset..).unwrap_or_default(), stride, ..view })
    }

    /// Calls `set` with the position and the bytes of every element that a sparse accessor replaces.
    fn for_sparse(
        &self,
        index: usize,
        sparse: &Sparse,
        count: usize,
        size: usize,
        mut set: impl FnMut(usize, &[u8]),
    ) -> Result<(), String> {
        let fail = |what: String| Err(format!("accessor {index}, sparse: {what}"));
        let n = whole(sparse.count);
        let Checked::Valid(component) = sparse.indices.component_type else {
            return fail("the component type of its indices is not 5121, 5123 or 5125".into());
        };
        let component = component.0;
        if n > count {
            return fail(format!("{n} of {count} elements are replaced"));
        }
        let slice = |view: Index<buffer::View>, offset: USize64, size: usize| {
            let bytes = self.view_bytes(view.value())?;
            let end = n.checked_mul(size).and_then(|length| length.checked_add(whole(offset)));
            end.and_then(|end| bytes.get(whole(offset)..end))
                .ok_or_else(|| format!("accessor {index}, sparse: {n} elements exceed buffer view {view}"))
        };
        let indices = slice(sparse.indices.buffer_view, sparse.indices.byte_offset, component.size())?;
        let values = slice(sparse.values.buffer_view, sparse.values.byte_offset, size)?;
        for (i, value) in indices.chunks_exact(component.size()).zip(values.chunks_exact(size)) {
            match read_u32(component, i) {
                Some(i) if (i as usize) < count => set(i as usize, value),
                Some(i) => return fail(format!("index {i} is out of range of {count} elements")),
                None => return fail("the indices are no unsigned whole numbers".into()),
            }
        }
        Ok(())
    }

    fn spend(&self, bytes: u64) -> Result<(), String> {
        let left = self.allowance.get().checked_sub(bytes);
        self.allowance.set(left.unwrap_or(0));
        left.map(|_| ()).ok_or_else(|| "the accessors together read more data than is allowed".into())
    }
}
