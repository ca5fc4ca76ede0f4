//! What a glTF file refers to: buffers, the numbers in them, images. Everything is checked before it is read, because a file
//! from elsewhere may say anything.

use crate::{
    hex::hex,
    image::{Extent, Image},
};
use base64::Engine as _;
use gltf::{
    Accessor, Document,
    accessor::{DataType, Dimensions, sparse::IndexType},
    buffer, image as gltf_image,
};
use sha2::{Digest as _, Sha256};
use std::{
    fs,
    path::{Path, PathBuf},
};

/// More numbers than this in one accessor are taken for a mistake.
const MAX_NUMBERS: usize = 1 << 28;
/// Longest side of a texture.
const MAX_TEXTURE_SIDE: u32 = 8192;
/// What is understood of what a file may require.
const EXTENSIONS: [&str; 4] = [
    "KHR_materials_emissive_strength",
    "KHR_materials_unlit",
    "KHR_mesh_quantization",
    "KHR_texture_transform",
];

/// A file with all that it refers to.
pub struct Data {
    pub document: Document,
    buffers: Vec<Vec<u8>>,
    images: Vec<Vec<u8>>,
    digest: Sha256,
}

impl Data {
    /// Reads a `.gltf` or `.glb` file, its buffers and its images.
    pub fn open(path: &Path) -> Result<Self, String> {
        let content = fs::read(path).map_err(|error| error.to_string())?;
        let wrong = |error: gltf::Error| format!("is not glTF 2.0: {error}");
        let file = gltf::Gltf::from_slice_without_validation(&content).map_err(wrong)?;
        let mut json = file.document.into_json();
        // The crate refuses one that only this module has to understand.
        for extension in std::mem::take(&mut json.extensions_required) {
            if !EXTENSIONS.contains(&&*extension) {
                return Err(format!(
                    "requires the extension {extension}, which is not understood here"
                ));
            }
        }
        let document = Document::from_json(json).map_err(wrong)?;
        let folder = path.parent().unwrap_or(Path::new("")).to_owned();
        let mut data = Self {
            document,
            buffers: Vec::new(),
            images: Vec::new(),
            digest: Sha256::new_with_prefix(&content),
        };
        data.read_buffers(&folder, file.blob)?;
        data.read_images(&folder)?;
        Ok(data)
    }

    /// SHA-256 of the file and all files that it names.
    pub fn sha256(&self) -> String {
        hex(&self.digest.clone().finalize())
    }

    fn read_buffers(&mut self, folder: &Path, mut blob: Option<Vec<u8>>) -> Result<(), String> {
        for buffer in self.document.buffers() {
            let what = format!("buffer {}", buffer.index());
            let bytes = match buffer.source() {
                buffer::Source::Bin => blob
                    .take()
                    .ok_or_else(|| format!("{what}: the file has no binary part"))?,
                buffer::Source::Uri(uri) => read_uri(folder, uri).map_err(|error| format!("{what}: {error}"))?,
            };
            if bytes.len() < buffer.length() {
                return Err(format!(
                    "{what}: has {} bytes and should have {}",
                    bytes.len(),
                    buffer.length()
                ));
            }
            self.digest.update(&bytes);
            self.buffers.push(bytes);
        }
        Ok(())
    }

    fn read_images(&mut self, folder: &Path) -> Result<(), String> {
        for image in self.document.images() {
            let what = format!("image {}", image.index());
            let bytes = match image.source() {
                gltf_image::Source::View { view, .. } => {
                    self.view(&view).map_err(|error| format!("{what}: {error}"))?.to_vec()
                }
                gltf_image::Source::Uri { uri, .. } => {
                    let bytes = read_uri(folder, uri).map_err(|error| format!("{what}: {error}"))?;
                    self.digest.update(&bytes);
                    bytes
                }
            };
            self.images.push(bytes);
        }
        Ok(())
    }

    fn view(&self, view: &buffer::View<'_>) -> Result<&[u8], String> {
        let buffer = &self.buffers[view.buffer().index()];
        let end = view.offset().checked_add(view.length());
        end.and_then(|end| buffer.get(view.offset()..end))
            .ok_or_else(|| format!("buffer view {} goes beyond its buffer", view.index()))
    }

    /// An accessor's numbers, one element after the other; integers that are normalised as −1 to 1 or 0 to 1.
    pub fn numbers(&self, accessor: &Accessor<'_>, dimensions: Dimensions) -> Result<Vec<f32>, String> {
        let (data_type, normalized) = (accessor.data_type(), accessor.normalized());
        let numbers = self.elements(accessor, dimensions, |bytes| number(bytes, data_type, normalized))?;
        match numbers.iter().position(|number| !number.is_finite()) {
            None => Ok(numbers),
            Some(at) => Err(format!(
                "accessor {}: element {} is not finite",
                accessor.index(),
                at / dimensions.multiplicity()
            )),
        }
    }

    /// The same of whole numbers.
    pub fn integers(&self, accessor: &Accessor<'_>, dimensions: Dimensions) -> Result<Vec<u32>, String> {
        let data_type = accessor.data_type();
        if matches!(data_type, DataType::F32 | DataType::I8 | DataType::I16) {
            return Err(format!(
                "accessor {}: must be of unsigned whole numbers",
                accessor.index()
            ));
        }
        self.elements(accessor, dimensions, |bytes| integer(bytes, data_type))
    }

    fn elements<T: Copy + Default>(
        &self,
        accessor: &Accessor<'_>,
        dimensions: Dimensions,
        parse: impl Fn(&[u8]) -> T,
    ) -> Result<Vec<T>, String> {
        let wrong = |problem: &str| format!("accessor {}: {problem}", accessor.index());
        if accessor.dimensions() != dimensions {
            let found = accessor.dimensions();
            return Err(wrong(&format!("is of {found:?} and should be of {dimensions:?}")));
        }
        let (n, size) = (dimensions.multiplicity(), accessor.data_type().size());
        let length = accessor.count().checked_mul(n).filter(|length| *length <= MAX_NUMBERS);
        let mut elements = vec![T::default(); length.ok_or_else(|| wrong("is larger than any model"))?];
        let beyond = || wrong("goes beyond its buffer view");
        let read = |bytes: &[u8], offset: usize, stride: usize, i: usize, into: &mut [T]| {
            let at = offset + i * stride;
            let element = bytes.get(at..at + n * size).ok_or_else(beyond)?;
            for (value, bytes) in into.iter_mut().zip(element.chunks_exact(size)) {
                *value = parse(bytes);
            }
            Ok::<_, String>(())
        };
        if let Some(view) = accessor.view() {
            let (bytes, stride) = (self.view(&view)?, view.stride().unwrap_or(n * size));
            for (i, into) in elements.chunks_exact_mut(n).enumerate() {
                read(bytes, accessor.offset(), stride, i, into)?;
            }
        }
        if let Some(sparse) = accessor.sparse() {
            let (indices, values) = (sparse.indices(), sparse.values());
            let index_type = match indices.index_type() {
                IndexType::U8 => DataType::U8,
                IndexType::U16 => DataType::U16,
                IndexType::U32 => DataType::U32,
            };
            let index_size = index_type.size();
            let (index_bytes, value_bytes) = (self.view(&indices.view())?, self.view(&values.view())?);
            for i in 0..sparse.count() {
                let at = indices.offset() + i * index_size;
                let bytes = index_bytes.get(at..at + index_size).ok_or_else(beyond)?;
                let index = integer(bytes, index_type) as usize;
                let into = elements.chunks_exact_mut(n).nth(index).ok_or_else(beyond)?;
                read(value_bytes, values.offset(), n * size, i, into)?;
            }
        }
        Ok(elements)
    }

    /// An image's texels as stored: red, green, blue and alpha.
    pub fn image(&self, index: usize) -> Result<Image<[u8; 4]>, String> {
        let what = |error: String| format!("image {index}: {error}");
        let mut reader = image::ImageReader::new(std::io::Cursor::new(&self.images[index]));
        let mut limits = image::Limits::default();
        (limits.max_image_width, limits.max_image_height) = (Some(MAX_TEXTURE_SIDE), Some(MAX_TEXTURE_SIDE));
        reader.limits(limits);
        let reader = reader.with_guessed_format().map_err(|error| what(error.to_string()))?;
        let decoded = reader.decode().map_err(|error| what(error.to_string()))?.into_rgba8();
        let extent = Extent::new(decoded.width(), decoded.height());
        Ok(Image::from_pixels(
            extent,
            decoded.pixels().map(|pixel| pixel.0).collect(),
        ))
    }
}

fn number(bytes: &[u8], data_type: DataType, normalized: bool) -> f32 {
    let of = |value: f32, max: f32| match normalized {
        true => (value / max).max(-1.0),
        false => value,
    };
    match data_type {
        DataType::F32 => f32::from_le_bytes(fixed(bytes)),
        DataType::I8 => of(i8::from_le_bytes(fixed(bytes)).into(), i8::MAX.into()),
        DataType::I16 => of(i16::from_le_bytes(fixed(bytes)).into(), i16::MAX.into()),
        DataType::U8 => of(bytes[0].into(), u8::MAX.into()),
        DataType::U16 => of(u16::from_le_bytes(fixed(bytes)).into(), u16::MAX.into()),
        DataType::U32 => of(u32::from_le_bytes(fixed(bytes)) as f32, u32::MAX as f32),
    }
}

fn integer(bytes: &[u8], data_type: DataType) -> u32 {
    match data_type {
        DataType::U8 | DataType::I8 => bytes[0].into(),
        DataType::U16 | DataType::I16 => u16::from_le_bytes(fixed(bytes)).into(),
        DataType::U32 | DataType::F32 => u32::from_le_bytes(fixed(bytes)),
    }
}

fn fixed<const N: usize>(bytes: &[u8]) -> [u8; N] {
    bytes.try_into().expect("elements were cut to their type's size")
}

/// A file beside the glTF file, or what the URI itself holds.
fn read_uri(folder: &Path, uri: &str) -> Result<Vec<u8>, String> {
    if let Some(data) = uri.strip_prefix("data:") {
        let (_, encoded) = data.split_once(";base64,").ok_or("its data URI is not in base64")?;
        return base64::engine::general_purpose::STANDARD
            .decode(encoded)
            .map_err(|error| format!("its data URI: {error}"));
    }
    if uri.contains("://") {
        return Err(format!("`{uri}` is no file; nothing is fetched from elsewhere"));
    }
    let name = percent_encoding::percent_decode_str(uri)
        .decode_utf8()
        .map_err(|_| format!("`{uri}` is no name of a file"))?;
    let path: PathBuf = folder.join(&*name);
    fs::read(&path).map_err(|error| format!("{}: {error}", path.display()))
}
