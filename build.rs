//! Records what the binary was built from: the git revision, so that every report can name it, and a hash of the sources,
//! so that nobody takes the results of other code for this code's.
use sha2::{Digest, Sha256};
use std::{
    fs,
    path::{Path, PathBuf},
    process::Command,
};

/// Whatever results depend on.
const SOURCES: [&str; 4] = ["src", "shaders", "crates", "Cargo.lock"];

fn main() {
    let revision = git(&["describe", "--always", "--dirty", "--abbrev=12"]);
    println!(
        "cargo:rustc-env=AFTERIMAGE_REVISION={}",
        revision.as_deref().unwrap_or("unknown")
    );
    // Elsewhere in a worktree of its own.
    if let Some(head) = git(&["rev-parse", "--git-path", "HEAD"]) {
        println!("cargo:rerun-if-changed={head}");
    }
    let mut hash = Sha256::new();
    for source in SOURCES {
        println!("cargo:rerun-if-changed={source}");
        add(&mut hash, Path::new(source));
    }
    let code: String = hash.finalize().iter().map(|byte| format!("{byte:02x}")).collect();
    println!("cargo:rustc-env=AFTERIMAGE_CODE={code}");
    println!("cargo:rerun-if-changed=migrations");
}

fn git(arguments: &[&str]) -> Option<String> {
    let output = Command::new("git").args(arguments).output().ok()?;
    let text = String::from_utf8(output.stdout).ok()?;
    output.status.success().then(|| text.trim().to_owned())
}

/// Every file below `path`, by name and content, in the order of their names.
fn add(hash: &mut Sha256, path: &Path) {
    if path.is_dir() {
        let entries = fs::read_dir(path).expect("a folder of the package");
        let mut entries: Vec<PathBuf> = entries.map(|entry| entry.expect("its entry").path()).collect();
        entries.sort();
        entries.iter().for_each(|entry| add(hash, entry));
    } else {
        hash.update(path.to_string_lossy().as_bytes());
        hash.update(fs::read(path).expect("a file of the package"));
    }
}
