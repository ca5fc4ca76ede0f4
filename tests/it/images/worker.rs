//! The decode worker's life: shared, limited, replaced when a file breaks it, and never outliving its parent.

use super::{TestPart, decoder_program, fixture, worker, write_parts};
use afterimage::image::files::exr::Compression;
use afterimage::image::files::{Backend, FileReader, ImageError, Limits};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

/// A file of which [`fake`] takes only the name.
fn named(folder: &Path, name: &str) -> PathBuf {
    let path = folder.join(name);
    write_parts(
        &path,
        ((0, 0), (7, 5)),
        vec![TestPart::mixed(None, (7, 5), Compression::ZIP16)],
    );
    path
}

fn fake(timeout: Duration) -> FileReader {
    let program = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/it/images/fake_decoder.sh");
    let limits = Limits {
        decode_timeout: timeout,
        ..Limits::default()
    };
    FileReader::with_decoder(Backend::OpenImageIo, limits, Some(program))
}

#[test]
fn a_crash_costs_one_error_that_names_file_and_signal() {
    let folder = tempfile::tempdir().expect("a folder");
    let reader = fake(Duration::from_secs(20));
    reader
        .describe(&named(folder.path(), "good.exr"))
        .expect("the worker works");
    let first = reader.decoder_id().expect("it is kept");
    let error = reader
        .describe(&named(folder.path(), "crash.exr"))
        .expect_err("it crashed");
    assert!(matches!(error, ImageError::DecoderCrashed { .. }), "{error}");
    let message = error.to_string();
    assert!(
        message.contains("crash.exr") && message.contains("signal: 11"),
        "{message}"
    );
    reader
        .describe(&named(folder.path(), "good.exr"))
        .expect("the next read works");
    assert_ne!(reader.decoder_id(), Some(first));
}

#[test]
fn a_hang_is_ended() {
    let folder = tempfile::tempdir().expect("a folder");
    let reader = fake(Duration::from_secs(2));
    let started = Instant::now();
    let error = reader.describe(&named(folder.path(), "hang.exr")).expect_err("it hung");
    assert!(matches!(error, ImageError::DecoderTimeout { .. }), "{error}");
    assert!(
        error.to_string().contains("hang.exr: not decoded within 2 s"),
        "{error}"
    );
    assert!(started.elapsed() < Duration::from_secs(20));
    reader
        .describe(&named(folder.path(), "good.exr"))
        .expect("the next read works");
}

#[test]
fn a_worker_of_another_version_is_named() {
    let folder = tempfile::tempdir().expect("a folder");
    let reader = fake(Duration::from_secs(20));
    let error = reader
        .describe(&named(folder.path(), "nonsense.exr"))
        .expect_err("nonsense")
        .to_string();
    assert!(error.contains("fake_decoder.sh is of another version"), "{error}");
}

#[test]
fn without_a_worker_the_error_says_what_to_install() {
    for program in [None, Some(PathBuf::from("/nowhere/decoder"))] {
        let reader = FileReader::with_decoder(Backend::Auto, Limits::default(), program);
        let error = reader
            .describe(&fixture("float.tif"))
            .expect_err("no worker")
            .to_string();
        for part in [
            "float.tif",
            "libopenimageio-dev",
            "cargo build -p oiio-decoder",
            "AFTERIMAGE_DECODER",
        ] {
            assert!(error.contains(part), "{error}");
        }
        assert!(reader.read_rgb(&fixture("mip.exr")).is_ok(), "OpenEXR needs none");
    }
}

#[test]
fn a_worker_that_was_killed_is_replaced_in_silence() {
    let reader = worker();
    assert_eq!(reader.decoder_id(), None, "started when needed");
    reader.read_rgb(&fixture("float.tif")).expect("read");
    let first = reader.decoder_id().expect("it runs");
    let killed = Command::new("sh")
        .args(["-c", &format!("kill -KILL {first}")])
        .status()
        .expect("sh");
    assert!(killed.success());
    // Its last thread is gone only some time after it was killed.
    let n_threads = || std::fs::read_dir(format!("/proc/{first}/task")).map_or(0, Iterator::count);
    let is_zombie = || std::fs::read_to_string(format!("/proc/{first}/status")).is_ok_and(|s| s.contains("Z (zombie)"));
    wait_until(|| n_threads() <= 1 && is_zombie());
    reader.read_rgb(&fixture("float.tif")).expect("another was started");
    assert_ne!(reader.decoder_id(), Some(first));
}

#[test]
fn clones_and_threads_share_one_limited_worker() {
    let reader = worker();
    let expected = reader.read_rgb(&fixture("float.tif")).expect("read");
    let id = reader.decoder_id().expect("it runs");
    std::thread::scope(|scope| {
        for _ in 0..4 {
            let (reader, expected) = (reader.clone(), &expected);
            scope.spawn(move || {
                for _ in 0..8 {
                    assert_eq!(&reader.read_rgb(&fixture("float.tif")).expect("read"), expected);
                }
            });
        }
    });
    assert_eq!(reader.decoder_id(), Some(id));
    let limits = std::fs::read_to_string(format!("/proc/{id}/limits")).expect("its limits");
    let memory = limits
        .lines()
        .find(|line| line.starts_with("Max address space"))
        .expect("listed");
    assert!(!memory.contains("unlimited"), "{memory}");
}

#[test]
fn the_worker_ends_with_its_parent_and_leaves_no_file() {
    let reader = worker();
    reader.read_rgb(&fixture("float.tif")).expect("read");
    let id = reader.decoder_id().expect("it runs");
    let open: Vec<_> = std::fs::read_dir(format!("/proc/{id}/fd"))
        .expect("its files")
        .filter_map(|entry| std::fs::read_link(entry.ok()?.path()).ok())
        .filter(|file| file.is_absolute() && !file.starts_with("/dev/null") && !file.starts_with("/proc"))
        .collect();
    let is_unlinked = |file: &PathBuf| file.to_string_lossy().ends_with("(deleted)");
    assert!(
        open.iter().any(is_unlinked),
        "the shared file has no name any more: {open:?}"
    );
    drop(reader);
    assert!(!Path::new(&format!("/proc/{id}")).exists(), "ended with its reader");

    // A parent that is killed runs no destructor; its end of the pipe closes all the same.
    let shared = tempfile::NamedTempFile::new().expect("a file");
    let settings = format!(
        r#"{{"pixels":{:?},"memory_bytes":4294967296,"image_mib":64}}"#,
        shared.path()
    );
    let mut child = Command::new(decoder_program())
        .arg(settings)
        .stdin(Stdio::piped())
        .stdout(Stdio::null())
        .spawn()
        .expect("started");
    drop(child.stdin.take());
    wait_until(|| child.try_wait().expect("waited").is_some());
}

fn wait_until(mut done: impl FnMut() -> bool) {
    let deadline = Instant::now() + Duration::from_secs(20);
    while !done() {
        assert!(Instant::now() < deadline, "waited in vain");
        std::thread::sleep(Duration::from_millis(20));
    }
}
