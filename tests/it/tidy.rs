//! The direction of dependencies that ARCHITECTURE.md draws, held by looking at the text.

use std::{fs, path::Path};

/// Every Rust file under `src`, as its path from there and its text without comments.
fn sources() -> Vec<(String, String)> {
    fn walk(folder: &Path, root: &Path, found: &mut Vec<(String, String)>) {
        for entry in fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                walk(&path, root, found);
            } else if path.extension().is_some_and(|extension| extension == "rs") {
                let text = fs::read_to_string(&path).unwrap();
                let code = text.lines().filter(|line| !line.trim_start().starts_with("//"));
                let name = path.strip_prefix(root).unwrap().to_str().unwrap().to_owned();
                found.push((name, code.collect::<Vec<_>>().join("\n")));
            }
        }
    }
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let mut found = Vec::new();
    walk(&root, &root, &mut found);
    found
}

/// The files that contain `word` although none of `allowed` begins their path.
fn trespassers(sources: &[(String, String)], word: &str, allowed: &[&str]) -> Vec<String> {
    sources
        .iter()
        .filter(|(path, text)| text.contains(word) && !allowed.iter().any(|prefix| path.starts_with(prefix)))
        .map(|(path, _)| path.clone())
        .collect()
}

#[test]
fn each_module_knows_only_what_it_may() {
    let sources = sources();
    let rules: [(&str, &[&str]); 10] = [
        (
            "wgpu::",
            &["gpu/", "taa/", "metrics/gpu", "run/", "bench/", "scene/", "stress/"],
        ),
        ("sqlx", &["store/"]),
        ("axum", &["server/", "web/"]),
        (
            "crate::store",
            &["store/", "server/", "web/", "worker.rs", "checker.rs"],
        ),
        ("crate::server", &["server/", "web/", "worker.rs"]),
        (
            "crate::run",
            &[
                "run/",
                "bench/",
                "stress/",
                "store/",
                "server/",
                "web/",
                "worker.rs",
                "gpu/adapter.rs",
                "gpu/workgroup.rs",
                "verdict/",
                "paper/",
            ],
        ),
        (
            "crate::taa",
            &[
                "taa/",
                "run/",
                "bench/",
                "stress/",
                "store/",
                "server/",
                "web/",
                "worker.rs",
                "paper/",
            ],
        ),
        ("crate::paper", &["paper/"]),
        ("unsafe ", &[]),
        ("println!", &["cli/"]),
    ];
    for (word, allowed) in rules {
        let found = trespassers(&sources, word, allowed);
        assert!(
            found.is_empty(),
            "`{word}` may only be named in {allowed:?}, not in {found:?}"
        );
    }
}

#[test]
fn the_rules_can_fail() {
    let sources = [("metrics/mod.rs".to_owned(), "use sqlx::query;".to_owned())];
    assert_eq!(trespassers(&sources, "sqlx", &["store/"]), ["metrics/mod.rs"]);
}

#[test]
fn files_stay_readable() {
    for (path, text) in sources() {
        let n_lines = text.split("#[cfg(test)]").next().unwrap().lines().count();
        assert!(n_lines <= 600, "{path} has {n_lines} lines of code: split it");
    }
}
