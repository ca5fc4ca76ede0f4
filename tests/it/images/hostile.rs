//! Files that are cut short, damaged or made to hurt: each is an error that names the file, never a panic or a hang.

use super::{Random, TestPart, fixture, native, worker, worker_for, write_parts};
use afterimage::image::files::exr::Compression;
use afterimage::image::files::{Backend, FileReader, ImageError, Limits};
use exr::image::FlatSamples;
use exr::prelude::{Blocks, Vec2};
use std::path::Path;

/// Reads everything that the file says it has.
fn read_all(reader: &FileReader, path: &Path) -> Result<(), ImageError> {
    let names = reader.describe(path)?.channel_names();
    reader.read(path, &names).map(drop)
}

fn assert_names_file(error: &ImageError, path: &Path) {
    let message = error.to_string();
    assert!(message.starts_with(&path.display().to_string()), "{message}");
}

/// An OpenEXR file of two parts, compressed.
fn two_parts(path: &Path, compression: Compression) {
    let size = (33, 40);
    let tiled = TestPart {
        blocks: Blocks::Tiles(Vec2(16, 16)),
        channels: vec![("tiled", FlatSamples::F32(vec![0.5; size.0 * size.1]))],
        ..TestPart::mixed(Some("second"), size, compression)
    };
    write_parts(
        path,
        ((0, 0), size),
        vec![TestPart::mixed(Some("first"), size, compression), tiled],
    );
}

#[test]
fn a_file_cut_short_anywhere_is_an_error() {
    let folder = tempfile::tempdir().expect("a folder");
    let (whole, cut) = (folder.path().join("whole.exr"), folder.path().join("cut.exr"));
    two_parts(&whole, Compression::ZIP16);
    let bytes = std::fs::read(&whole).expect("read");
    let readers = [native(), worker()];
    for reader in &readers {
        read_all(reader, &whole).expect("the whole file is sound");
    }
    for twentieth in 0..20 {
        let length = bytes.len() * twentieth / 20;
        std::fs::write(&cut, &bytes[..length]).expect("written");
        for reader in &readers {
            assert_names_file(&read_all(reader, &cut).expect_err("it was cut"), &cut);
        }
    }
    std::fs::write(&cut, &bytes[..bytes.len() - 1]).expect("written");
    assert_names_file(&read_all(&readers[0], &cut).expect_err("one byte is missing"), &cut);
}

#[test]
fn damaged_bytes_are_survived() {
    let folder = tempfile::tempdir().expect("a folder");
    let auto = worker_for(Backend::Auto);
    let readers = [native(), worker()];
    let base = folder.path().join("base.exr");
    let mut random = Random(7);
    for compression in [
        Compression::ZIP16,
        Compression::PIZ,
        Compression::B44,
        Compression::PXR24,
        Compression::RLE,
    ] {
        two_parts(&base, compression);
        let bytes = std::fs::read(&base).expect("read");
        let path = folder.path().join(format!("{compression:?}.exr"));
        for _ in 0..12 {
            std::fs::write(&path, mutated(&bytes, &mut random)).expect("written");
            for reader in &readers {
                if let Err(error) = read_all(reader, &path) {
                    assert_names_file(&error, &path);
                }
            }
        }
    }
    for name in [
        "float.tif",
        "uint16.tif",
        "uint10.dpx",
        "radiance.hdr",
        "uint8.bmp",
        "uint8.jpg",
        "dwaa.exr",
    ] {
        let bytes = std::fs::read(fixture(name)).expect("read");
        let path = folder.path().join(name);
        for _ in 0..10 {
            std::fs::write(&path, mutated(&bytes, &mut random)).expect("written");
            if let Err(error) = read_all(&auto, &path) {
                assert_names_file(&error, &path);
            }
        }
        read_all(&auto, &fixture(name)).expect("what is sound is still read");
    }
}

/// One to eight bytes changed; half of them near the start, where headers are.
fn mutated(bytes: &[u8], random: &mut Random) -> Vec<u8> {
    let mut bytes = bytes.to_vec();
    for _ in 0..=random.below(8) {
        let range = if random.below(2) == 0 {
            bytes.len().min(700)
        } else {
            bytes.len()
        };
        // The first bytes stay, or the file would only be of another format.
        let at = 12 + random.below(range - 12);
        bytes[at] = random.next() as u8;
    }
    bytes
}

#[test]
fn a_header_that_claims_a_huge_image_is_refused_at_once() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("huge.exr");
    for compression in [Compression::Uncompressed, Compression::ZIP16, Compression::PIZ] {
        for blocks in [Blocks::ScanLines, Blocks::Tiles(Vec2(16, 16))] {
            let part = TestPart {
                blocks,
                ..TestPart::mixed(None, (33, 40), compression)
            };
            write_parts(&path, ((0, 0), (33, 40)), vec![part]);
            let mut bytes = std::fs::read(&path).expect("read");
            let mut set = |attribute: &[u8], offset: usize, value: i32| {
                let name = bytes
                    .windows(attribute.len())
                    .position(|at| at == attribute)
                    .expect("is there");
                bytes[name + attribute.len() + offset..][..4].copy_from_slice(&value.to_le_bytes());
            };
            // After an attribute's name and type come its length and its value: here x and y, from and to.
            for window in [&b"dataWindow\0box2i\0"[..], b"displayWindow\0box2i\0"] {
                set(window, 12, 99_999);
                set(window, 16, 99_999);
            }
            // Consistent with it, or that alone would give the file away.
            let n_chunks = match blocks {
                Blocks::ScanLines => 100_000_usize.div_ceil(compression.scan_lines_per_block()),
                Blocks::Tiles(_) => (100_000 / 16) * (100_000 / 16),
            };
            set(b"chunkCount\0int\0", 4, n_chunks as i32);
            std::fs::write(&path, &bytes).expect("written");
            let error = read_all(&native(), &path).expect_err("refused").to_string();
            assert!(error.contains("huge.exr: claims to be 100000×100000 pixels"), "{error}");
            assert_names_file(&read_all(&worker(), &path).expect_err("refused"), &path);
        }
    }
}

#[test]
fn a_png_that_claims_a_huge_image_is_refused_at_once() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("huge.png");
    image::DynamicImage::new_rgb8(8, 8).save(&path).expect("written");
    let mut bytes = std::fs::read(&path).expect("read");
    bytes[16..20].copy_from_slice(&16_384_u32.to_be_bytes());
    bytes[20..24].copy_from_slice(&16_384_u32.to_be_bytes());
    let mut sum = flate2::Crc::new();
    sum.update(&bytes[12..29]);
    bytes[29..33].copy_from_slice(&sum.sum().to_be_bytes());
    std::fs::write(&path, &bytes).expect("written");
    for reader in [native(), worker()] {
        assert_names_file(&read_all(&reader, &path).expect_err("refused"), &path);
    }
}

#[test]
fn limits_hold_for_files_that_are_sound() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("sound.exr");
    two_parts(&path, Compression::ZIP16);
    let sound = Limits::default();
    let cases = [
        (
            Limits { max_side: 39, ..sound },
            "claims to be 33×40 pixels; at most 39 a side",
        ),
        (
            Limits {
                max_channels: 5,
                ..sound
            },
            "has 6 channels; at most 5",
        ),
        // 2 + 2 + 4 + 4 + 4 bytes in the first part and 4 in the second.
        (
            Limits {
                max_bytes: 33 * 40 * 20 - 1,
                ..sound
            },
            "MiB of pixels",
        ),
        (
            Limits {
                max_expansion: 1,
                ..sound
            },
            "no compression gives more than 1:1",
        ),
    ];
    assert!(
        FileReader::new(
            Backend::Native,
            Limits {
                max_bytes: 33 * 40 * 20,
                ..sound
            }
        )
        .describe(&path)
        .is_ok()
    );
    for (limits, expected) in cases {
        let error = FileReader::new(Backend::Native, limits)
            .describe(&path)
            .expect_err("refused")
            .to_string();
        assert!(error.contains("sound.exr: ") && error.contains(expected), "{error}");
    }
}

#[test]
fn what_is_no_image_is_named() {
    let folder = tempfile::tempdir().expect("a folder");
    let text = folder.path().join("notes.exr");
    std::fs::write(&text, "Not an image at all, whatever its name says.\n").expect("written");
    let empty = folder.path().join("empty.exr");
    std::fs::write(&empty, "").expect("written");
    for reader in [native(), worker(), worker_for(Backend::Auto)] {
        for path in [&text, &empty] {
            let error = read_all(&reader, path).expect_err("no image");
            assert_names_file(&error, path);
            assert!(matches!(error, ImageError::UnknownFormat { .. }), "{error}");
        }
        let missing = folder.path().join("missing.exr");
        assert_names_file(&read_all(&reader, &missing).expect_err("no file"), &missing);
        assert!(read_all(&reader, folder.path()).is_err(), "a folder is no image");
    }
}
