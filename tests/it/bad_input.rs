//! Sequences that are broken or hostile: every error names the thing at fault, and nothing is left behind.
#![allow(clippy::unwrap_used, reason = "in tests a panic is the message")]

use crate::sequence::{ALL, copy_of, edit, fixture, reader};
use afterimage::{
    image::{
        Extent, Image,
        files::exr::{FloatFormat, write_rgb_exr},
    },
    sequence::{
        Sequence, SequenceError,
        archive::{self, Limits},
    },
};
use flate2::{Compression, write::GzEncoder};
use serde_json::{Value, json};
use std::{
    fs,
    io::{Cursor, Write},
    os::unix::fs::symlink,
    path::Path,
};
use tempfile::TempDir;

/// What opening, checking and loading every frame of a damaged copy says.
fn complaint(folder: &TempDir) -> String {
    let all = || -> Result<(), SequenceError> {
        let sequence = Sequence::open(folder.path(), &reader())?;
        sequence.verify_files()?;
        (0..sequence.n_frames()).try_for_each(|index| sequence.load(index, ALL).map(drop))
    };
    all().expect_err("the damage must be noticed").to_string()
}

/// Loading must notice by itself what the cheap check finds first.
fn complaint_of_load(folder: &TempDir, index: usize) -> String {
    let sequence = Sequence::open(folder.path(), &reader()).unwrap();
    sequence.load(index, ALL).unwrap_err().to_string()
}

fn assert_names(message: &str, names: &[&str]) {
    for name in names {
        assert!(message.contains(name), "`{name}` is not in: {message}");
    }
}

#[test]
fn a_whole_sequence_has_nothing_to_complain_about() {
    for name in ["pan", "static", "engine"] {
        let sequence = Sequence::open(&fixture(name), &reader()).unwrap();
        sequence.verify_files().unwrap();
    }
}

#[test]
fn a_truncated_image_is_named() {
    for keep in [0.02, 0.5, 0.99] {
        let folder = copy_of("pan");
        let path = folder.path().join("input/0003.exr");
        let bytes = fs::read(&path).unwrap();
        fs::write(&path, &bytes[..(bytes.len() as f64 * keep) as usize]).unwrap();
        assert_names(&complaint(&folder), &["frame 2", "0003.exr"]);
        assert_names(&complaint_of_load(&folder, 2), &["frame 2", "0003.exr"]);
    }
}

#[test]
fn a_missing_frame_is_named() {
    let folder = copy_of("pan");
    fs::remove_file(folder.path().join("reference/0007.exr")).unwrap();
    let message = "frame 6, reference: `reference/0007.exr` is missing from the sequence's folder";
    assert_eq!(complaint(&folder), message);
    assert_eq!(complaint_of_load(&folder, 6), message);
    let hash = Sequence::open(folder.path(), &reader()).unwrap().hash();
    assert_eq!(hash.unwrap_err().to_string(), message);
}

#[test]
fn a_wrong_channel_name_gets_the_nearest_one() {
    let folder = copy_of("pan");
    edit(&folder, |manifest| {
        manifest["depth"]["channel"] = json!("ViewLayer.Dept.Z")
    });
    let names = ["depth", "0001.exr", "ViewLayer.Dept.Z", "ViewLayer.Depth.Z"];
    assert_names(&complaint(&folder), &names);
    assert_names(&complaint_of_load(&folder, 0), &names[1..]);
}

fn flat(folder: &TempDir, name: &str, extent: Extent) {
    let image = Image::filled(extent, [0.5; 3]);
    write_rgb_exr(&folder.path().join(name), &image, FloatFormat::Half).unwrap();
}

#[test]
fn images_of_other_sizes_are_named_with_both() {
    let folder = copy_of("static");
    flat(&folder, "reference.exr", Extent::new(64, 37));
    let message = "frame 0, reference: `reference.exr` is 64×37 pixels, but output_size is 61×37";
    assert_eq!(complaint(&folder), message);
    assert_eq!(complaint_of_load(&folder, 0), message);

    let folder = copy_of("engine");
    edit(&folder, |manifest| manifest["render_size"] = json!([48, 33]));
    assert_names(
        &complaint(&folder),
        &["frame 0, color", "color/0000.png", "48×32", "render_size is 48×33"],
    );
}

#[test]
fn a_motion_file_of_another_size_is_named() {
    let folder = copy_of("engine");
    flat(&folder, "motion.exr", Extent::new(24, 16));
    edit(&folder, |manifest| {
        manifest["motion"]["path"] = json!("motion.exr");
        manifest["motion"]["channels"] = json!(["R", "G"]);
    });
    let message = "frame 0, motion: `motion.exr` is 24×16 pixels, but render_size is 48×32";
    assert_eq!(complaint(&folder), message);
    assert_eq!(complaint_of_load(&folder, 0), message);
}

#[test]
fn manifests_are_refused_by_field() {
    type Change<'a> = &'a dyn Fn(&mut Value);
    let cases: [(Change, &str); 4] = [
        (
            &|m| m["color"]["transfr"] = json!("linear"),
            "color.transfr: unknown field; did you mean `transfer`?",
        ),
        (&|m| m["frames"] = json!([]), "frames: is empty"),
        (
            &|m| m["color"]["path"] = json!("../pan/{index}.exr"),
            "color.path: `../pan/{index}.exr` leaves the sequence's",
        ),
        (&|m| m["frames"][4]["jitter"] = json!([0.0, 7.0]), "frames[4].jitter"),
    ];
    for (change, expected) in cases {
        let folder = copy_of("pan");
        edit(&folder, change);
        assert_names(&complaint(&folder), &["manifest.json", expected]);
    }
}

#[test]
fn a_folder_without_a_manifest_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let shown = folder.path().display().to_string();
    assert_names(&complaint(&folder), &[&shown, "no manifest.json"]);
    let nowhere = Sequence::open(&folder.path().join("nowhere"), &reader()).unwrap_err();
    assert_names(&nowhere.to_string(), &["nowhere", "no manifest.json"]);
}

#[test]
fn a_link_out_of_the_folder_is_refused_and_one_inside_is_not() {
    let folder = copy_of("pan");
    let frame = folder.path().join("input/0002.exr");
    fs::remove_file(&frame).unwrap();
    symlink("0001.exr", &frame).unwrap();
    Sequence::open(folder.path(), &reader())
        .unwrap()
        .verify_files()
        .unwrap();
    fs::remove_file(&frame).unwrap();
    symlink(fixture("pan/input/0002.exr"), &frame).unwrap();
    let message = complaint(&folder);
    assert_names(
        &message,
        &[
            "frame 1",
            "`input/0002.exr` is a link that leaves the sequence's folder",
        ],
    );
    assert_eq!(complaint_of_load(&folder, 1), message);
}

/// Extracts `bytes`, checks that a failure leaves nothing behind, and gives its message.
fn extract(bytes: &[u8], limits: Limits) -> Result<(), String> {
    let folder = tempfile::tempdir().unwrap();
    let archive = folder.path().join("upload");
    fs::write(&archive, bytes).unwrap();
    let result = archive::extract(&archive, &folder.path().join("into"), limits);
    let left: Vec<_> = fs::read_dir(folder.path()).unwrap().collect();
    assert_eq!(left.len(), if result.is_ok() { 2 } else { 1 }, "{left:?}");
    assert!(!folder.path().parent().unwrap().join("escaped").exists());
    result.map_err(|error| error.to_string())
}

fn refusal(bytes: &[u8]) -> String {
    extract(bytes, Limits::default()).unwrap_err()
}

type Tar = tar::Builder<Vec<u8>>;

fn tar(build: impl FnOnce(&mut Tar)) -> Vec<u8> {
    let mut tar = tar::Builder::new(Vec::new());
    add(&mut tar, b"manifest.json", tar::EntryType::Regular, b"{}");
    build(&mut tar);
    tar.into_inner().unwrap()
}

/// Adds an entry whose name may be as bad as it likes, which the builder's own functions would refuse.
fn add(tar: &mut Tar, name: &[u8], kind: tar::EntryType, content: &[u8]) {
    let mut header = tar::Header::new_gnu();
    header.as_old_mut().name[..name.len()].copy_from_slice(name);
    header.set_entry_type(kind);
    header.set_size(content.len() as u64);
    header.set_mode(0o644);
    header.set_cksum();
    tar.append(&header, content).unwrap();
}

fn gzip(bytes: &[u8]) -> Vec<u8> {
    let mut gzip = GzEncoder::new(Vec::new(), Compression::best());
    gzip.write_all(bytes).unwrap();
    gzip.finish().unwrap()
}

fn zip(files: &[(&str, &[u8])]) -> Vec<u8> {
    let mut zip = zip::ZipWriter::new(Cursor::new(Vec::new()));
    for (name, content) in files {
        zip.start_file(*name, zip::write::SimpleFileOptions::default()).unwrap();
        zip.write_all(content).unwrap();
    }
    zip.finish().unwrap().into_inner()
}

#[test]
fn good_archives_are_extracted() {
    let files: [(&str, &[u8]); 2] = [("./manifest.json", b"{}"), ("a/b/c.exr", b"x")];
    extract(&zip(&files), Limits::default()).unwrap();
    let nested: [(&str, &[u8]); 2] = [("top/manifest.json", b"{}"), ("top/c.exr", b"x")];
    extract(&zip(&nested), Limits::default()).unwrap();
    extract(&tar(|_| {}), Limits::default()).unwrap();
    extract(&gzip(&tar(|_| {})), Limits::default()).unwrap();
}

#[test]
fn bombs_are_stopped_and_named() {
    let zeros = vec![0; 32 << 20];
    let tarred = tar(|tar| add(tar, b"bomb.exr", tar::EntryType::Regular, &zeros));
    assert_names(&refusal(&gzip(&tarred)), &["upload", "`bomb.exr`", "expands too far"]);
    let zipped = zip(&[("manifest.json", b"{}"), ("bomb.exr", &zeros)]);
    assert_names(
        &refusal(&zipped),
        &["`bomb.exr` expands too far", "200 times the archive"],
    );
    // A name as long as the bomb would be held in memory.
    let named = tar(|tar| add(tar, b"././@LongLink", tar::EntryType::GNULongName, &zeros));
    assert_names(&refusal(&gzip(&named)), &["upload", "expands too far"]);
}

#[test]
fn limits_hold_to_the_byte_and_the_entry() {
    let files: [(&str, &[u8]); 2] = [("manifest.json", b"{}"), ("a.exr", b"12345678")];
    let limits = |max_bytes, max_entries| Limits {
        max_bytes,
        max_entries,
        ..Limits::default()
    };
    extract(&zip(&files), limits(10, 2)).unwrap();
    let too_large = extract(&zip(&files), limits(9, 2)).unwrap_err();
    assert_names(&too_large, &["`a.exr` expands too far: at most 9 bytes"]);
    let too_many = extract(&zip(&files), limits(10, 1)).unwrap_err();
    assert_names(&too_many, &["`a.exr` is one too many: at most 1"]);
}

#[test]
fn entries_that_leave_the_folder_are_named() {
    for name in [
        "../escaped",
        "a/../../escaped",
        "/tmp/escaped",
        "..\\escaped",
        "C:/escaped",
    ] {
        let tarred = tar(|tar| add(tar, name.as_bytes(), tar::EntryType::Regular, b"x"));
        assert_names(&refusal(&tarred), &[&format!("`{name}` leaves the archive's folder")]);
    }
    let zipped = zip(&[("manifest.json", b"{}"), ("../escaped", b"x")]);
    assert_names(&refusal(&zipped), &["`../escaped` leaves the archive's folder"]);
}

#[test]
fn links_and_devices_are_named() {
    use tar::EntryType::{Block, Char, Fifo, Link, Symlink};
    for kind in [Symlink, Link, Char, Block, Fifo] {
        let tarred = tar(|tar| {
            let mut header = tar::Header::new_gnu();
            header.set_entry_type(kind);
            header.set_size(0);
            tar.append_link(&mut header, "trap", "/etc/passwd").unwrap();
        });
        assert_names(&refusal(&tarred), &["`trap` is a link or a device"]);
    }
    let mut zip = zip::ZipWriter::new(Cursor::new(Vec::new()));
    let options = zip::write::SimpleFileOptions::default();
    zip.add_symlink("trap", "/etc/passwd", options).unwrap();
    let zipped = zip.finish().unwrap().into_inner();
    assert_names(&refusal(&zipped), &["`trap` is a link or a device"]);
}

#[test]
fn names_that_are_no_text_or_come_twice_are_refused() {
    let latin = tar(|tar| add(tar, b"caf\xe9.exr", tar::EntryType::Regular, b"x"));
    assert_names(&refusal(&latin), &["caf", "has a name that is not UTF-8"]);
    let twice = tar(|tar| add(tar, b"manifest.json", tar::EntryType::Regular, b"{}"));
    assert_names(&refusal(&twice), &["`manifest.json` appears twice"]);
    // No writer makes it, so one name is changed afterwards, in the entry and in the directory.
    let mut zipped = zip(&[("manifest.json", b"{}"), ("frame_a.exr", b"x"), ("frame_b.exr", b"y")]);
    while let Some(at) = zipped.windows(11).position(|name| name == b"frame_b.exr") {
        zipped[at..at + 11].copy_from_slice(b"frame_a.exr");
    }
    assert_names(&refusal(&zipped), &["`frame_a.exr` appears twice"]);
}

#[test]
fn archives_that_are_none_are_named() {
    assert_names(&refusal(b"plain text"), &["upload", "neither tar, tar.gz nor zip"]);
    assert_names(&refusal(b""), &["neither tar, tar.gz nor zip"]);
    let whole = gzip(&tar(|_| {}));
    assert_names(&refusal(&whole[..whole.len() / 2]), &["upload"]);
    let whole = tar(|tar| add(tar, b"a.exr", tar::EntryType::Regular, &[7; 2048]));
    assert_names(&refusal(&whole[..2000]), &["`a.exr`", "unexpected EOF"]);
    assert_names(
        &refusal(&whole[..3700]),
        &["`a.exr` is followed by what cannot be read"],
    );
    let whole = zip(&[("manifest.json", b"{}")]);
    assert_names(&refusal(&whole[..whole.len() / 2]), &["upload"]);
    // The checksum lies behind what a tar reader reads.
    let whole = gzip(&tar(|_| {}));
    let n = whole.len();
    assert_names(&refusal(&whole[..n - 8]), &["upload", "unexpected end of file"]);
    let mut damaged = whole.clone();
    damaged[n - 8] ^= 1;
    assert_names(&refusal(&damaged), &["upload", "corrupt"]);
    let endless = gzip(&[tar(|_| {}), vec![0; 2 << 20]].concat());
    assert_names(&refusal(&endless), &["goes on behind its end"]);
    let two_tops = zip(&[("a/manifest.json", b"{}"), ("b/manifest.json", b"{}")]);
    assert_names(
        &refusal(&two_tops),
        &["has no manifest.json at its top or in its only top-level folder"],
    );
}

#[test]
fn extracting_never_replaces_what_is_there() {
    let folder = tempfile::tempdir().unwrap();
    let archive = folder.path().join("upload");
    fs::write(&archive, tar(|_| {})).unwrap();
    let into = folder.path().join("into");
    fs::create_dir(&into).unwrap();
    fs::write(into.join("mine"), "kept").unwrap();
    assert!(archive::extract(&archive, &into, Limits::default()).is_err());
    assert_eq!(fs::read_to_string(into.join("mine")).unwrap(), "kept");
    assert!(Path::new(&archive).exists());
}
