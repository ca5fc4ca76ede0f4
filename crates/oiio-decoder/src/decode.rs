//! Answers requests: describes files, and writes planes into the shared file.

use crate::oiio::{BaseType, Input, Oiio, PartSpec, Sample};
use crate::protocol::{Channel, Format, Header, Part, PlaneRequest, Reply, Request, SampleType, Settings, Window};
use memmap2::MmapMut;
use std::ffi::CStr;
use std::fs::File;

/// More parts than any renderer writes; a TIFF may claim millions.
const MAX_PARTS: usize = 256;
/// More channels than afterimage accepts; what lies between gets its clearer message.
const MAX_CHANNELS: i32 = 1024;

/// OpenImageIO and where its pixels go.
pub struct Decoder {
    oiio: Oiio,
    pixels: File,
}

impl Decoder {
    /// Takes the shared file.
    pub fn new(settings: &Settings, pixels: File) -> Self {
        Self {
            oiio: Oiio::new(settings.image_mib, MAX_CHANNELS),
            pixels,
        }
    }

    /// Does what is asked.
    pub fn answer(&mut self, request: &Request) -> Reply {
        let done = match request {
            Request::Describe { path, format } => self
                .oiio
                .open(path, reader(*format))
                .and_then(|mut input| describe(&mut input))
                .map(Reply::Header),
            Request::Read { path, format, planes } => self
                .oiio
                .open(path, reader(*format))
                .and_then(|mut input| read(&mut input, planes, &self.pixels))
                .map(|()| Reply::Pixels),
        };
        done.unwrap_or_else(Reply::Error)
    }
}

/// OpenImageIO's name of the only reader that may see the file.
fn reader(format: Format) -> &'static CStr {
    match format {
        Format::Exr => c"openexr",
        Format::Png => c"png",
        Format::Tiff => c"tiff",
        Format::Dpx => c"dpx",
        Format::Hdr => c"hdr",
        Format::Jpeg => c"jpeg",
        Format::Bmp => c"bmp",
    }
}

fn describe(input: &mut Input<'_>) -> Result<Header, String> {
    let mut parts = Vec::new();
    loop {
        let spec = match input.part(parts.len() as i32) {
            Ok(spec) => spec,
            // Past the last one; some readers call that an error, others do not.
            Err(_) if !parts.is_empty() => return Ok(Header { parts }),
            Err(error) => return Err(error),
        };
        if parts.len() == MAX_PARTS {
            return Err(format!("it has more than {MAX_PARTS} parts"));
        }
        if spec.is_flat == 0 {
            return Err("deep images and volumes are not read".into());
        }
        parts.push(Part {
            name: input.part_name(),
            data: window(spec.data)?,
            display: window(spec.display)?,
            channels: (0..spec.n_channels)
                .map(|index| channel(input, index))
                .collect::<Result<_, _>>()?,
        });
    }
}

fn window([x, y, width, height]: [i32; 4]) -> Result<Window, String> {
    let side = |length| u32::try_from(length).map_err(|_| format!("a side of {length} pixels"));
    Ok(Window {
        x,
        y,
        width: side(width)?,
        height: side(height)?,
    })
}

fn channel(input: &mut Input<'_>, index: i32) -> Result<Channel, String> {
    let (name, base) = input.channel(index);
    let sample = match base {
        Some(BaseType::U8) => SampleType::U8,
        Some(BaseType::U16) => SampleType::U16,
        Some(BaseType::U32) => SampleType::U32,
        Some(BaseType::F16) => SampleType::F16,
        Some(BaseType::F32 | BaseType::F64) => SampleType::F32,
        None => {
            return Err(format!(
                "channel `{name}` holds signed or 64-bit integers, which are not read"
            ));
        }
    };
    Ok(Channel { name, sample })
}

fn read(input: &mut Input<'_>, planes: &[PlaneRequest], pixels: &File) -> Result<(), String> {
    if planes.is_empty() {
        return Ok(());
    }
    // SAFETY: the parent alone has this file besides us. It makes it longer before asking, never shorter, and neither
    // reads nor writes it until we have answered.
    let mut map = unsafe { MmapMut::map_mut(pixels) }.map_err(|error| error.to_string())?;
    let mut rest = &mut map[..];
    let mut targets = Vec::with_capacity(planes.len());
    for plane in planes {
        let n_bytes = plane.n_pixels.checked_mul(4).ok_or("a plane that is too large")?;
        let (target, after) = rest
            .split_at_mut_checked(n_bytes)
            .ok_or("the shared file is too short")?;
        targets.push((*plane, target));
        rest = after;
    }
    // Channels are decoded in contiguous ranges, and reading again decompresses again: one range a part and kind.
    while let Some((first, _)) = targets.first() {
        let first = *first;
        let same = |plane: &PlaneRequest| (plane.part, plane.integer) == (first.part, first.integer);
        let (group, others) = targets.into_iter().partition(|(plane, _)| same(plane));
        read_group(input, group)?;
        targets = others;
    }
    Ok(())
}

/// Planes of one part and kind.
fn read_group(input: &mut Input<'_>, group: Vec<(PlaneRequest, &mut [u8])>) -> Result<(), String> {
    let part = i32::try_from(group[0].0.part).map_err(|error| error.to_string())?;
    let spec = input.part(part)?;
    let first_channel = i32::try_from(group[0].0.channel).map_err(|error| error.to_string())?;
    match input.channel(first_channel).1 {
        _ if group[0].0.integer => scatter(input, part, group, |value: u32| value.to_ne_bytes()),
        Some(BaseType::U8) => scatter(input, part, group, |value: u8| (f32::from(value) / 255.0).to_ne_bytes()),
        Some(BaseType::U16) => {
            let (shift, max) = significant(&spec);
            scatter(input, part, group, |value: u16| {
                (f32::from(value >> shift) / max).to_ne_bytes()
            })
        }
        _ => scatter(input, part, group, |value: f32| value.to_ne_bytes()),
    }
}

/// Formats of 10 or 12 bits come with their top bits repeated below: how far to shift, and the largest value then.
fn significant(spec: &PartSpec) -> (u32, f32) {
    let bits = if (9..16).contains(&spec.bits) {
        spec.bits as u32
    } else {
        16
    };
    (16 - bits, ((1_u32 << bits) - 1) as f32)
}

fn scatter<T: Sample>(
    input: &mut Input<'_>,
    part: i32,
    group: Vec<(PlaneRequest, &mut [u8])>,
    convert: impl Fn(T) -> [u8; 4],
) -> Result<(), String> {
    let n_pixels = group[0].0.n_pixels;
    let channels = || group.iter().map(|(plane, _)| plane.channel);
    let begin = channels().min().unwrap_or(0);
    let end = channels().max().unwrap_or(0) + 1;
    let index = |channel: usize| i32::try_from(channel).map_err(|error| error.to_string());
    let samples: Vec<T> = input.read(part, index(begin)?, index(end)?, n_pixels)?;
    for (plane, target) in group {
        let column = samples.iter().skip(plane.channel - begin).step_by(end - begin);
        target
            .as_chunks_mut()
            .0
            .iter_mut()
            .zip(column)
            .for_each(|(out, &value)| *out = convert(value));
    }
    Ok(())
}
