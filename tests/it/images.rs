//! Image files: the native readers and the decode worker give the same pixels, and the right ones.

mod formats;
mod hostile;
mod worker;

use afterimage::image::Extent;
use afterimage::image::files::exr::Compression;
use afterimage::image::files::{Backend, FileReader, Limits, Plane, Planes, SampleType};
use exr::image::{AnyChannel, AnyChannels, Encoding, FlatSamples, Image, Layer};
use exr::meta::attribute::{IntegerBounds, LineOrder};
use exr::meta::header::{ImageAttributes, LayerAttributes};
use exr::prelude::{Blocks, Text, Vec2, WritableImage as _};
use half::f16;
use std::path::{Path, PathBuf};

/// A file that `fixtures/images/README.md` describes.
fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/images").join(name)
}

fn native() -> FileReader {
    FileReader::new(Backend::Native, Limits::default())
}

/// Fails where the worker is not built: what needs it must never be skipped in silence.
fn worker() -> FileReader {
    worker_for(Backend::OpenImageIo)
}

fn worker_for(backend: Backend) -> FileReader {
    let program = decoder_program();
    assert!(
        program.is_file(),
        "build the decode worker first: cargo build -p oiio-decoder"
    );
    FileReader::with_decoder(backend, Limits::default(), Some(program))
}

fn decoder_program() -> PathBuf {
    Path::new(env!("CARGO_BIN_EXE_afterimage")).with_file_name("afterimage-oiio-decoder")
}

/// SplitMix64: the same numbers everywhere.
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    fn below(&mut self, n: usize) -> usize {
        (self.next() % n as u64) as usize
    }
}

/// A part of an OpenEXR file to be written.
struct TestPart {
    name: Option<&'static str>,
    position: (i32, i32),
    size: (usize, usize),
    compression: Compression,
    blocks: Blocks,
    channels: Vec<(&'static str, FlatSamples)>,
}

impl TestPart {
    /// Half, float and integer channels of smooth and noisy values, with zeros, negatives, infinities and ids that no
    /// float holds.
    fn mixed(name: Option<&'static str>, size: (usize, usize), compression: Compression) -> Self {
        let n = size.0 * size.1;
        let mut random = Random(n as u64);
        let smooth = (0..n).map(|i| (i % size.0) as f32 * 0.25 - (i / size.0) as f32);
        let halves = smooth.clone().map(f16::from_f32).collect();
        let noisy = (0..n).map(|i| match i % 17 {
            0 => f32::INFINITY,
            5 => -0.0,
            _ => (random.below(1 << 20) as f32 - 3e5) / 257.0,
        });
        let noisy: Vec<f32> = noisy.collect();
        let bits = noisy.iter().map(|&value| f16::from_f32(value)).collect();
        let ids = (0..n as u32).map(|i| 0xffff_ffff - i / 7).collect();
        Self {
            name,
            position: (0, 0),
            size,
            compression,
            blocks: Blocks::ScanLines,
            channels: vec![
                ("R", FlatSamples::F16(halves)),
                ("G", FlatSamples::F16(bits)),
                ("Z", FlatSamples::F32(noisy)),
                ("depth.V", FlatSamples::F32(smooth.collect())),
                ("id", FlatSamples::U32(ids)),
            ],
        }
    }
}

/// Writes an OpenEXR file as other programs do: several parts, any windows.
fn write_parts(path: &Path, display: ((i32, i32), (usize, usize)), parts: Vec<TestPart>) {
    let layers = parts.into_iter().map(|part| {
        let channels = part
            .channels
            .into_iter()
            .map(|(name, samples)| AnyChannel::new(name, samples));
        let attributes = LayerAttributes {
            layer_name: part.name.map(Text::from),
            layer_position: Vec2(part.position.0, part.position.1),
            ..LayerAttributes::default()
        };
        let encoding = Encoding {
            compression: part.compression,
            blocks: part.blocks,
            line_order: LineOrder::Increasing,
        };
        Layer::new(part.size, attributes, encoding, AnyChannels::sort(channels.collect()))
    });
    let bounds = IntegerBounds::new(display.0, display.1);
    let layers: Vec<_> = layers.collect();
    Image::from_layers(ImageAttributes::new(bounds), layers)
        .write()
        .to_file(path)
        .expect("the fixture is written");
}

/// Where two results differ, in words; none where every bit is the same.
fn difference(a: &Planes, b: &Planes) -> Option<String> {
    let bits = |plane: &Plane| -> Vec<u32> {
        match plane {
            Plane::F32(samples) => samples.iter().map(|sample| sample.to_bits()).collect(),
            Plane::U32(samples) => samples.clone(),
        }
    };
    let kind = |plane: &Plane| matches!(plane, Plane::U32(_));
    if a.extent != b.extent || a.planes.len() != b.planes.len() {
        return Some(format!(
            "{} × {} against {} × {}",
            a.extent,
            a.planes.len(),
            b.extent,
            b.planes.len()
        ));
    }
    if a.samples != b.samples {
        return Some(format!("{:?} against {:?}", a.samples, b.samples));
    }
    let differing = |(a, b): (&Plane, &Plane)| {
        if kind(a) != kind(b) {
            return Some("another kind".to_owned());
        }
        let (a, b) = (bits(a), bits(b));
        let at = a.iter().zip(&b).position(|(a, b)| a != b);
        at.map(|at| format!("sample {at}: {:08x} against {:08x}", a[at], b[at]))
            .or_else(|| (a.len() != b.len()).then(|| "another length".to_owned()))
    };
    let mut planes = a.planes.iter().zip(&b.planes).enumerate();
    planes.find_map(|(index, pair)| differing(pair).map(|what| format!("plane {index}, {what}")))
}

/// Reads all channels both ways and insists on the same bits.
fn read_both(path: &Path, native: &FileReader, worker: &FileReader) -> Planes {
    let names = native.describe(path).expect("native header").channel_names();
    let ours = native.read(path, &names).expect("native");
    let theirs = worker.read(path, &names).expect("OpenImageIO");
    assert_eq!(difference(&ours, &theirs), None, "{}", path.display());
    ours
}

fn strings(names: &[&str]) -> Vec<String> {
    names.iter().map(|&name| name.to_owned()).collect()
}

fn floats(plane: &Plane) -> &[f32] {
    match plane {
        Plane::F32(samples) => samples,
        Plane::U32(_) => panic!("integers where floats were expected"),
    }
}

#[test]
fn every_compression_type_and_odd_size_reads_the_same_both_ways() {
    let (native, worker) = (native(), worker());
    let folder = tempfile::tempdir().expect("a folder");
    use Compression::{B44, B44A, PIZ, PXR24, RLE, Uncompressed, ZIP1, ZIP16};
    for compression in [Uncompressed, RLE, ZIP1, ZIP16, PIZ, PXR24, B44, B44A] {
        for size in [(1, 1), (7, 5), (61, 37), (130, 70)] {
            for blocks in [Blocks::ScanLines, Blocks::Tiles(Vec2(16, 24))] {
                let path = folder.path().join(format!("{compression:?}_{size:?}_{blocks:?}.exr"));
                let part = TestPart {
                    blocks,
                    ..TestPart::mixed(None, size, compression)
                };
                write_parts(&path, ((0, 0), size), vec![part]);
                read_both(&path, &native, &worker);
            }
        }
    }
}

#[test]
fn values_come_as_they_were_written_and_ids_stay_integers() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("values.exr");
    let part = TestPart::mixed(None, (61, 37), Compression::ZIP16);
    let FlatSamples::U32(ids) = part.channels[4].1.clone() else {
        panic!("the ids")
    };
    let FlatSamples::F32(depth) = part.channels[2].1.clone() else {
        panic!("the floats")
    };
    let FlatSamples::F16(green) = part.channels[1].1.clone() else {
        panic!("the halves")
    };
    write_parts(&path, ((0, 0), (61, 37)), vec![part]);
    let green: Vec<f32> = green.into_iter().map(f16::to_f32).collect();
    let expected = Planes {
        extent: Extent::new(61, 37),
        planes: vec![Plane::U32(ids), Plane::F32(depth), Plane::F32(green)],
        samples: vec![SampleType::U32, SampleType::F32, SampleType::F16],
    };
    for reader in [native(), worker()] {
        let names = strings(&["id", "Z", "G"]);
        assert_eq!(reader.extent(&path, &names).expect("extent"), expected.extent);
        let read = reader.read(&path, &names).expect("read");
        assert_eq!(difference(&read, &expected), None);
    }
}

#[test]
fn the_comparison_sees_one_changed_bit_and_swapped_channels() {
    let folder = tempfile::tempdir().expect("a folder");
    let (right, wrong) = (folder.path().join("right.exr"), folder.path().join("wrong.exr"));
    let size = (61, 37);
    write_parts(
        &right,
        ((0, 0), size),
        vec![TestPart::mixed(None, size, Compression::ZIP16)],
    );
    let mut part = TestPart::mixed(None, size, Compression::ZIP16);
    let FlatSamples::F32(depth) = &mut part.channels[2].1 else {
        panic!("the floats")
    };
    depth[1000] = f32::from_bits(depth[1000].to_bits() ^ 1);
    write_parts(&wrong, ((0, 0), size), vec![part]);
    let (native, worker) = (native(), worker());
    let all = strings(&["R", "G", "Z"]);
    let ours = native.read(&right, &all).expect("native");
    let changed = difference(&ours, &worker.read(&wrong, &all).expect("read")).expect("one bit was changed");
    assert!(changed.starts_with("plane 2, sample 1000"), "{changed}");
    let swapped = worker.read(&right, &strings(&["G", "R", "Z"])).expect("read");
    assert!(difference(&ours, &swapped).is_some());
}

#[test]
fn channels_of_several_parts_are_found_by_full_name() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("parts.exr");
    let size = (33, 21);
    let constant = |value: f32| FlatSamples::F32(vec![value; size.0 * size.1]);
    let part = |name, compression, channels| TestPart {
        channels,
        ..TestPart::mixed(Some(name), size, compression)
    };
    write_parts(
        &path,
        ((0, 0), size),
        vec![
            part(
                "ViewLayer.Combined",
                Compression::ZIP16,
                vec![
                    ("ViewLayer.Combined.R", constant(1.0)),
                    ("ViewLayer.Combined.G", constant(2.0)),
                ],
            ),
            part(
                "ViewLayer.Vector",
                Compression::PIZ,
                vec![("X", constant(3.0)), ("Y", constant(4.0))],
            ),
            TestPart::mixed(Some("noise"), size, Compression::Uncompressed),
        ],
    );
    let (native, worker) = (native(), worker());
    read_both(&path, &native, &worker);
    for reader in [native, worker] {
        let names = strings(&[
            "ViewLayer.Vector.Y",
            "ViewLayer.Combined.R",
            "X",
            "ViewLayer.Combined.G",
        ]);
        let read = reader.read(&path, &names).expect("read");
        let first: Vec<f32> = read.planes.iter().map(|plane| floats(plane)[7]).collect();
        assert_eq!(first, [4.0, 1.0, 3.0, 2.0]);
    }
}

#[test]
fn data_windows_of_any_place_and_size_are_put_on_the_display_window() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("windows.exr");
    let (native, worker) = (native(), worker());
    let display = ((-3, 2), (20, 12));
    let windows = [
        ((-3, 2), (20, 12)),
        ((2, 5), (4, 3)),
        ((-10, -10), (50, 40)),
        ((10, 8), (30, 30)),
        ((-9, 0), (8, 5)),
        ((-3, 2), (20, 5)),
        ((100, 100), (3, 3)),
    ];
    for compression in [Compression::Uncompressed, Compression::ZIP16] {
        for (position, size) in windows {
            // Every pixel says where it is.
            let samples = (0..size.0 * size.1).map(|i| {
                let (x, y) = (position.0 + (i % size.0) as i32, position.1 + (i / size.0) as i32);
                (1000 * (y + 20) + (x + 20)) as u32
            });
            let channels = vec![("where", FlatSamples::U32(samples.collect()))];
            let part = TestPart {
                position,
                channels,
                ..TestPart::mixed(None, size, compression)
            };
            write_parts(&path, display, vec![part]);
            let read = read_both(&path, &native, &worker);
            assert_eq!(read.extent, Extent::new(20, 12));
            let expected = (0..20 * 12).map(|i| {
                let (x, y) = (display.0.0 + i % 20, display.0.1 + i / 20);
                let inside = |at: i32, start: i32, len: usize| at >= start && at < start + len as i32;
                let has_data = inside(x, position.0, size.0) && inside(y, position.1, size.1);
                if has_data {
                    (1000 * (y + 20) + (x + 20)) as u32
                } else {
                    0
                }
            });
            assert_eq!(read.planes, [Plane::U32(expected.collect())], "{position:?} {size:?}");
        }
    }
}

#[test]
fn a_wrong_channel_name_lists_what_there_is() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("frame.exr");
    write_parts(
        &path,
        ((0, 0), (7, 5)),
        vec![TestPart::mixed(None, (7, 5), Compression::ZIP16)],
    );
    for reader in [native(), worker()] {
        let error = reader
            .read(&path, &strings(&["R", "depth.Z"]))
            .expect_err("there is none")
            .to_string();
        assert!(
            error.contains("frame.exr: no channel `depth.Z`; there is `depth.V`, "),
            "{error}"
        );
    }
}
