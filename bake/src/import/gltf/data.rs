//! The document with its binary data: buffers, buffer views (decompressed where they are compressed) and accessors.

use std::cell::Cell;
use std::path::Path;

use super::json::{Accessor, Document, MeshoptView};
use super::meshopt;
use crate::error::ImportError;
use crate::import::files;

/// How many values all accessors of one file may decode to, counted each time one is read, for each byte of its buffers: a
/// short file can point to the same bytes any number of times, and one that does so for sane reasons stays far below.
const VALUES_PER_BYTE: u64 = 32;
/// What is allowed beyond that, and what is never exceeded.
const FREE_VALUES: u64 = 1 << 22;
const MAX_VALUES: u64 = 1 << 27;
/// Greatest count of an accessor whose elements are zero without any bytes behind them.
const MAX_ZERO_COUNT: usize = 1 << 20;
/// Greatest size of all decompressed buffer views together, in bytes.
const MAX_DECOMPRESSED_BYTES: usize = 1 << 29;

/// A parsed glTF file.
pub struct Source<'a> {
    pub path: &'a Path,
    pub document: Document,
    views: Vec<View>,
    buffers: Vec<Option<Vec<u8>>>,
    /// Values that may still be read.
    values_left: Cell<u64>,
}

/// Where the bytes of a buffer view are.
enum View {
    /// In a buffer: index, first byte, length.
    Slice(usize, usize, usize),
    /// Decompressed, with the stride that the compression states.
    Decompressed(Vec<u8>, usize),
}

/// Elements of an accessor, converted.
pub struct Elements<T> {
    /// Values of one element.
    pub width: usize,
    /// `[count * width]`.
    pub values: Vec<T>,
}

impl<T> Elements<T> {
    pub fn count(&self) -> usize {
        self.values.len() / self.width
    }
}

#[derive(Clone, Copy, PartialEq)]
enum Component {
    I8,
    U8,
    I16,
    U16,
    U32,
    F32,
}

impl Component {
    fn new(code: u32) -> Option<Self> {
        Some(match code {
            5120 => Self::I8,
            5121 => Self::U8,
            5122 => Self::I16,
            5123 => Self::U16,
            5125 => Self::U32,
            5126 => Self::F32,
            _ => return None,
        })
    }

    fn size_bytes(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::U32 | Self::F32 => 4,
        }
    }

    /// Reads one value as `f64`, exact for every type; `bytes` holds at least its size.
    fn read(self, b: &[u8]) -> f64 {
        match self {
            Self::I8 => f64::from(b[0] as i8),
            Self::U8 => f64::from(b[0]),
            Self::I16 => f64::from(i16::from_le_bytes([b[0], b[1]])),
            Self::U16 => f64::from(u16::from_le_bytes([b[0], b[1]])),
            Self::U32 => f64::from(u32::from_le_bytes([b[0], b[1], b[2], b[3]])),
            Self::F32 => f64::from(f32::from_le_bytes([b[0], b[1], b[2], b[3]])),
        }
    }

    /// What a normalised integer is divided by.
    fn norm(self) -> f64 {
        match self {
            Self::I8 => 127.0,
            Self::U8 => 255.0,
            Self::I16 => 32767.0,
            Self::U16 => 65535.0,
            Self::U32 => 4_294_967_295.0,
            Self::F32 => 1.0,
        }
    }
}

impl<'a> Source<'a> {
    /// Resolves the buffers of `document`; `chunk` is the binary chunk of a `.glb`.
    pub fn new(
        path: &'a Path,
        document: Document,
        chunk: Option<&[u8]>,
    ) -> Result<Self, ImportError> {
        let mut source = Self {
            path,
            document,
            views: Vec::new(),
            buffers: Vec::new(),
            values_left: Cell::new(0),
        };
        for i in 0..source.document.buffers.len() {
            let buffer = source.load_buffer(i, chunk)?;
            source.buffers.push(buffer);
        }
        let mut decompressed_bytes = 0;
        for i in 0..source.document.buffer_views.len() {
            let view = source.resolve_view(i, &mut decompressed_bytes)?;
            source.views.push(view);
        }
        let buffer_bytes: usize = source.buffers.iter().flatten().map(Vec::len).sum();
        let allowed = VALUES_PER_BYTE * (buffer_bytes + decompressed_bytes) as u64 + FREE_VALUES;
        source.values_left.set(allowed.min(MAX_VALUES));
        Ok(source)
    }

    /// [`ImportError::Malformed`] of this file.
    pub fn bad(&self, place: impl Into<String>, reason: impl Into<String>) -> ImportError {
        ImportError::malformed(self.path, place, reason)
    }

    /// `list[index]`, or an error at `place` that names `what` was looked for.
    pub fn get<'b, T>(
        &self,
        list: &'b [T],
        index: usize,
        what: &str,
        place: impl Fn() -> String,
    ) -> Result<&'b T, ImportError> {
        list.get(index).ok_or_else(|| {
            let reason = format!("{what} {index} does not exist: there are {}", list.len());
            self.bad(place(), reason)
        })
    }

    /// The bytes that `uri` stands for: inline, or of a file beside this one.
    pub fn read_uri(&self, uri: &str, place: &str) -> Result<Vec<u8>, ImportError> {
        match files::data_uri(uri) {
            Some(data) => data.map_err(|reason| self.bad(place, reason)),
            None => {
                let file = files::resolve(self.path, uri).map_err(|r| self.bad(place, r))?;
                files::read(&file).map_err(|error| {
                    let reason = match error {
                        ImportError::Io { path, source } => {
                            format!("'{}' cannot be read: {source}", path.display())
                        }
                        other => other.to_string(),
                    };
                    self.bad(place, reason)
                })
            }
        }
    }

    fn load_buffer(&self, i: usize, chunk: Option<&[u8]>) -> Result<Option<Vec<u8>>, ImportError> {
        let place = format!("buffers[{i}]");
        let buffer = &self.document.buffers[i];
        let fallback = meshopt::EXTENSIONS
            .iter()
            .filter_map(|key| buffer.extensions.get(*key))
            .any(|e| e["fallback"] == true);
        let mut bytes = match &buffer.uri {
            Some(uri) => self.read_uri(uri, &place)?,
            None if fallback => return Ok(None),
            None => match chunk {
                Some(chunk) if i == 0 => chunk.to_vec(),
                _ => return Err(self.bad(place, "it has no uri, and no binary chunk holds it")),
            },
        };
        if bytes.len() < buffer.byte_length {
            let reason = format!(
                "it is {} bytes long and says {}",
                bytes.len(),
                buffer.byte_length
            );
            return Err(self.bad(place, reason));
        }
        bytes.truncate(buffer.byte_length);
        Ok(Some(bytes))
    }

    /// `length` bytes of a buffer from `offset` on.
    fn buffer_slice(
        &self,
        buffer: usize,
        offset: usize,
        length: usize,
        place: &str,
    ) -> Result<&[u8], ImportError> {
        let bytes = self.get(&self.buffers, buffer, "buffer", || place.to_string())?;
        let bytes = bytes
            .as_ref()
            .ok_or_else(|| self.bad(place, format!("buffer {buffer} has no data")))?;
        offset
            .checked_add(length)
            .and_then(|end| bytes.get(offset..end))
            .ok_or_else(|| {
                let reason = format!(
                    "{length} bytes from {offset} on do not fit into buffer {buffer} of {} bytes",
                    bytes.len()
                );
                self.bad(place, reason)
            })
    }

    fn resolve_view(&self, i: usize, decompressed_bytes: &mut usize) -> Result<View, ImportError> {
        let view = &self.document.buffer_views[i];
        let place = format!("bufferViews[{i}]");
        let packed = meshopt::EXTENSIONS
            .iter()
            .find_map(|key| Some((key, view.extensions.get(*key)?)));
        let Some((key, extension)) = packed else {
            let has_data = self.buffers.get(view.buffer).is_some_and(Option::is_some);
            if has_data || view.buffer >= self.buffers.len() {
                self.buffer_slice(view.buffer, view.byte_offset, view.byte_length, &place)?;
            }
            return Ok(View::Slice(view.buffer, view.byte_offset, view.byte_length));
        };
        let place = format!("{place}.extensions.{key}");
        let packed: MeshoptView = serde_path_to_error::deserialize(extension)
            .map_err(|e| self.bad(format!("{place}.{}", e.path()), e.inner().to_string()))?;
        let bytes = self.buffer_slice(
            packed.buffer,
            packed.byte_offset,
            packed.byte_length,
            &place,
        )?;
        let size = packed
            .count
            .checked_mul(packed.byte_stride)
            .filter(|&s| s <= MAX_DECOMPRESSED_BYTES - *decompressed_bytes)
            .ok_or_else(|| {
                self.bad(
                    &place,
                    "it and the views before it unpack to more than 512 MiB",
                )
            })?;
        *decompressed_bytes += size;
        let data = meshopt::decompress(&packed, bytes).map_err(|r| self.bad(&place, r))?;
        Ok(View::Decompressed(data, packed.byte_stride))
    }

    /// The bytes of a buffer view, and its stride where it states one.
    pub fn view(&self, index: usize, place: &str) -> Result<(&[u8], Option<usize>), ImportError> {
        match self.get(&self.views, index, "buffer view", || place.to_string())? {
            &View::Slice(buffer, offset, length) => Ok((
                self.buffer_slice(buffer, offset, length, &format!("bufferViews[{index}]"))?,
                self.document.buffer_views[index].byte_stride,
            )),
            View::Decompressed(bytes, stride) => Ok((bytes, Some(*stride))),
        }
    }

    /// The elements of accessor `index` as floats; normalised integers become -1 to 1 or 0 to 1.
    ///
    /// Errors: it does not exist, does not fit its data, is not of one of the `kinds` ("VEC3"), or holds a value that is
    /// not finite. `user` is the place that refers to it.
    pub fn floats(
        &self,
        index: usize,
        kinds: &[&str],
        user: &str,
    ) -> Result<Elements<f32>, ImportError> {
        let elements = self.floats_unchecked(index, kinds, user)?;
        if let Some(i) = elements.values.iter().position(|v| !v.is_finite()) {
            let reason = format!("element {} is infinite or not a number", i / elements.width);
            return Err(self.bad(format!("accessors[{index}] ({user})"), reason));
        }
        Ok(elements)
    }

    /// As [`Self::floats`], and values that are not finite pass.
    pub fn floats_unchecked(
        &self,
        index: usize,
        kinds: &[&str],
        user: &str,
    ) -> Result<Elements<f32>, ImportError> {
        let accessor = self.get(&self.document.accessors, index, "accessor", || user.into())?;
        let component = self.component(accessor, index)?;
        let norm = if accessor.normalized {
            component.norm()
        } else {
            1.0
        };
        let signed = matches!(component, Component::I8 | Component::I16);
        self.elements(index, kinds, user, |b| {
            let value = component.read(b) / norm;
            (if signed && accessor.normalized {
                value.max(-1.0)
            } else {
                value
            }) as f32
        })
    }

    /// The elements of accessor `index` as unsigned integers. Errors: as [`Self::floats`], or it is not of an unsigned
    /// integer type.
    pub fn integers(
        &self,
        index: usize,
        kinds: &[&str],
        user: &str,
    ) -> Result<Elements<u32>, ImportError> {
        let accessor = self.get(&self.document.accessors, index, "accessor", || user.into())?;
        let component = self.component(accessor, index)?;
        if !matches!(component, Component::U8 | Component::U16 | Component::U32) {
            let place = format!("accessors[{index}] ({user})");
            return Err(self.bad(place, "its componentType is not an unsigned integer"));
        }
        self.elements(index, kinds, user, |b| component.read(b) as u32)
    }

    /// The type of one value of `accessor`.
    fn component(&self, accessor: &Accessor, index: usize) -> Result<Component, ImportError> {
        Component::new(accessor.component_type).ok_or_else(|| {
            let reason = format!("componentType {} does not exist", accessor.component_type);
            self.bad(format!("accessors[{index}]"), reason)
        })
    }

    /// Reads accessor `index` value by value; nothing is allocated before its count is known to fit its data.
    fn elements<T: Copy + Default>(
        &self,
        index: usize,
        kinds: &[&str],
        user: &str,
        read: impl Fn(&[u8]) -> T,
    ) -> Result<Elements<T>, ImportError> {
        let accessor = self.get(&self.document.accessors, index, "accessor", || user.into())?;
        let place = format!("accessors[{index}]");
        let bad = |reason: String| self.bad(format!("{place} ({user})"), reason);
        let size = self.component(accessor, index)?.size_bytes();
        if !kinds.contains(&accessor.kind.as_str()) {
            return Err(bad(format!(
                "its type is '{}' where {} is needed",
                files::shorten(&accessor.kind, 16),
                kinds.join(" or ")
            )));
        }
        let width = match accessor.kind.as_str() {
            "SCALAR" => 1,
            "VEC2" => 2,
            "VEC3" => 3,
            "VEC4" => 4,
            "MAT4" => 16,
            _ => return Err(bad("its type does not exist".into())),
        };
        let count = accessor.count;
        if count == 0 {
            return Err(bad("its count is 0".into()));
        }
        let value_count = (count as u64).saturating_mul(width as u64);
        let left = self.values_left.get().checked_sub(value_count);
        self.values_left.set(left.ok_or_else(|| {
            bad(format!(
                "its count of {count} is more than the file has data for"
            ))
        })?);
        let strided = |view: usize, offset: usize, count: usize, element: usize, tight: bool| {
            let (bytes, stride) = self.view(view, &place)?;
            let stride = if tight {
                element
            } else {
                stride.unwrap_or(element)
            };
            let end = (count - 1)
                .checked_mul(stride)
                .and_then(|n| n.checked_add(element))
                .and_then(|n| n.checked_add(offset));
            if stride < element || end.is_none_or(|end| end > bytes.len()) {
                return Err(bad(format!(
                    "{count} elements of {element} bytes, {stride} bytes apart from {offset} on, do not fit into buffer \
                     view {view} of {} bytes",
                    bytes.len()
                )));
            }
            Ok(bytes[offset..].chunks(stride))
        };
        let mut values = Vec::new();
        match accessor.buffer_view {
            Some(view) => {
                let rows = strided(view, accessor.byte_offset, count, size * width, false)?;
                values.reserve_exact(count * width);
                for row in rows.take(count) {
                    values.extend(row[..size * width].chunks_exact(size).map(&read));
                }
            }
            None if count <= MAX_ZERO_COUNT => values.resize(count * width, T::default()),
            None => {
                return Err(bad(format!(
                    "its count of {count} is too large for one without a buffer view"
                )));
            }
        }
        if let Some(sparse) = &accessor.sparse {
            if sparse.count == 0 || sparse.count > count {
                let reason = format!("its count of {} is not 1 to {count}", sparse.count);
                return Err(self.bad(format!("{place}.sparse"), reason));
            }
            let indices = &sparse.indices;
            let unsigned = Component::new(indices.component_type)
                .filter(|c| matches!(c, Component::U8 | Component::U16 | Component::U32))
                .ok_or_else(|| bad("its sparse indices are not unsigned integers".into()))?;
            let (view, offset) = (indices.buffer_view, indices.byte_offset);
            let at = strided(view, offset, sparse.count, unsigned.size_bytes(), true)?;
            let (view, offset) = (sparse.values.buffer_view, sparse.values.byte_offset);
            let rows = strided(view, offset, sparse.count, size * width, true)?;
            for (at, row) in at.zip(rows).take(sparse.count) {
                let i = unsigned.read(at) as usize;
                if i >= count {
                    let reason = format!("index {i} is not below the count of {count}");
                    return Err(self.bad(format!("{place}.sparse.indices"), reason));
                }
                for (value, b) in values[i * width..][..width]
                    .iter_mut()
                    .zip(row.chunks_exact(size))
                {
                    *value = read(b);
                }
            }
        }
        Ok(Elements { width, values })
    }
}
