//! Files by content: uploads that go on, sequences made of files, and images rendered elsewhere.

use crate::support::service::{Client, Idle, TestService, fixture, packed};
use serde_json::{Value, json};
use sha2::{Digest as _, Sha256};
use std::{collections::BTreeMap, fs, io::Write as _, net::TcpStream, path::Path};

fn hash(bytes: &[u8]) -> String {
    Sha256::digest(bytes).iter().map(|byte| format!("{byte:02x}")).collect()
}

/// Puts a file; its hash.
fn put(client: &Client, bytes: &[u8]) -> String {
    let hash = hash(bytes);
    let answer = client.send("PUT", &format!("/blobs/{hash}"), &[], bytes);
    assert!(matches!(answer.status, 200 | 201), "{}", answer.text());
    hash
}

#[test]
fn an_upload_goes_on_where_it_broke_off() {
    let service = TestService::start(Idle, &["--max-archive-mib", "1"]);
    let client = service.client();
    let bytes: Vec<u8> = (0..100_000u32).map(|i| (i.wrapping_mul(i) % 251) as u8).collect();
    let path = format!("/blobs/{}", hash(&bytes));
    assert_eq!(client.send("HEAD", &path, &[], &[]).status, 404);
    let part = |first: usize, last: usize| {
        let range = format!("bytes {first}-{last}/{}", bytes.len());
        client.send("PUT", &path, &[("content-range", &range)], &bytes[first..=last])
    };
    let answer = part(0, 39_999);
    assert_eq!((answer.status, answer.header("upload-offset")), (202, "40000"));
    let head = client.send("HEAD", &path, &[], &[]);
    assert_eq!((head.status, head.header("upload-offset")), (204, "40000"));
    let wrong = part(50_000, 59_999);
    wrong.is_problem(409, "wrong_offset", None, "40000 bytes are here");
    assert_eq!(wrong.header("upload-offset"), "40000");

    // A connection that dies in the middle leaves what came.
    let mut stream = TcpStream::connect(service.address).unwrap();
    let request = format!(
        "PUT /api/v1{path} HTTP/1.1\r\nhost: localhost\r\ncontent-range: bytes 40000-99999/100000\r\ncontent-length: 60000\r\n\r\n"
    );
    stream.write_all(request.as_bytes()).unwrap();
    stream.write_all(&bytes[40_000..70_000]).unwrap();
    stream.flush().unwrap();
    std::thread::sleep(std::time::Duration::from_millis(200));
    drop(stream);
    let deadline = std::time::Instant::now() + std::time::Duration::from_secs(10);
    let answer = loop {
        let head = client.send("HEAD", &path, &[], &[]);
        let offset: usize = head.header("upload-offset").parse().unwrap();
        if offset > 40_000 {
            let answer = part(offset, bytes.len() - 1);
            // The service may not have seen yet that the connection is gone.
            if answer.status != 409 {
                break answer;
            }
        }
        assert!(
            std::time::Instant::now() < deadline,
            "nothing of the broken upload was kept, or it never ended"
        );
    };
    assert_eq!(answer.status, 201, "{}", answer.text());
    assert_eq!(answer.json()["n_bytes"], bytes.len());

    // All of it came, but nobody was told what became of it.
    let other = [&bytes[1..], &[0]].concat();
    let all = format!("/blobs/{}", hash(&other));
    let range = |range: &str| client.send("PUT", &all, &[("content-range", range)], b"");
    std::fs::write(
        service.data.path().join("blobs").join(format!("{}.part", hash(&other))),
        &other,
    )
    .unwrap();
    range("bytes */99999").is_problem(409, "wrong_offset", None, "100000 bytes are here");
    assert_eq!(range("bytes */100000").status, 201);
    assert_eq!(client.send("HEAD", &path, &[], &[]).status, 200);
    assert_eq!(
        client.send("PUT", &path, &[], b"anything").status,
        200,
        "what is here is not sent again"
    );
}

#[test]
fn a_blob_is_what_its_name_says() {
    let service = TestService::start(Idle, &["--max-archive-mib", "1"]);
    let client = service.client();
    let path = format!("/blobs/{}", "0".repeat(64));
    client
        .send("PUT", &path, &[], b"x")
        .is_problem(422, "wrong_hash", Some("sha256"), "nothing of it");
    assert_eq!(client.send("HEAD", &path, &[], &[]).status, 404);
    client
        .send("PUT", "/blobs/xyz", &[], b"x")
        .is_problem(422, "invalid_hash", Some("sha256"), "64 digits");
    client.send("PUT", &path, &[("content-range", "0-1")], b"x").is_problem(
        400,
        "bad_range",
        Some("content-range"),
        "FIRST",
    );
    let range = format!("bytes 0-0/{}", 2 << 20);
    client
        .send("PUT", &path, &[("content-range", &range)], b"x")
        .is_problem(413, "blob_too_large", None, "1 MiB");
    client
        .send("PUT", &path, &[], &vec![0; 2 << 20])
        .is_problem(413, "blob_too_large", None, "1 MiB");
    assert_eq!(put(&client, b"x"), hash(b"x"));
}

/// Every file under `folder`, by its path from there.
fn files(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let mut found = BTreeMap::new();
    let mut waiting = vec![folder.to_owned()];
    while let Some(path) = waiting.pop() {
        for entry in fs::read_dir(path).unwrap() {
            let path = entry.unwrap().path();
            match path.is_dir() {
                true => waiting.push(path),
                false => {
                    let name = path.strip_prefix(folder).unwrap().to_str().unwrap().to_owned();
                    found.insert(name, fs::read(path).unwrap());
                }
            }
        }
    }
    found
}

#[test]
fn a_sequence_of_blobs_is_the_sequence_of_the_archive() {
    let service = TestService::start(Idle, &[]);
    let client = service.client();
    let mut files = files(&fixture("pan"));
    let manifest: Value = serde_json::from_slice(&files.remove("manifest.json").unwrap()).unwrap();
    let hashes: BTreeMap<&String, String> = files.iter().map(|(name, bytes)| (name, hash(bytes))).collect();
    let request = json!({"name": "pan", "manifest": manifest, "files": hashes});
    let refused = client.post("/sequences", &request);
    refused.is_problem(422, "missing_blobs", Some("files"), "put them");
    let missing = refused.json()["missing"].as_array().unwrap().len();
    assert_eq!(missing, files.len());
    files.values().for_each(|bytes| drop(put(&client, bytes)));
    let made = client.post("/sequences", &request);
    assert_eq!(made.status, 201, "{}", made.text());
    let from_archive = client.put("pan", &packed("pan"));
    assert_eq!(
        (from_archive.status, &from_archive.json()["hash"]),
        (200, &made.json()["hash"])
    );
    assert_eq!(client.post("/sequences", &request).status, 200);

    let archive = client.get("/sequences/pan/archive");
    assert_eq!(archive.header("content-type"), "application/x-tar");
    assert_eq!(
        client.put("again", &archive.body).json()["hash"],
        made.json()["hash"],
        "what was sent comes back"
    );

    let with = |name: &str| {
        let mut request = request.clone();
        request["files"][name] = json!(hash(&files["input/0001.exr"]));
        client.post("/sequences", &request)
    };
    for name in [
        "../x",
        "/etc/x",
        "a/../../x",
        "manifest.json",
        "",
        "a/",
        "a/.",
        "./a",
        "a//b",
    ] {
        with(name).is_problem(422, "invalid_field", Some("files"), "relative path");
    }
    with("input/0001.exr/x").is_problem(422, "invalid_field", Some("files"), "in another file's way");
    client
        .post("/sequences", &json!({"name": "pan", "manifest": {}, "files": {}}))
        .is_problem(422, "invalid_sequence", Some("schema"), "missing field");
    let mut broken = request.clone();
    broken["manifest"]["render_size"] = json!([1, 1]);
    let problem = client.post("/sequences", &broken);
    assert_eq!(
        (problem.status, problem.json()["code"].as_str()),
        (422, Some("invalid_sequence")),
        "{}",
        problem.text()
    );
    assert!(!problem.text().contains("spool"), "{}", problem.text());
    assert_eq!(fs::read_dir(service.data.path().join("spool")).unwrap().count(), 0);
}

#[test]
fn images_rendered_elsewhere_are_compared_with_the_reference() {
    let service = TestService::start(Idle, &[]);
    let client = service.client();
    assert_eq!(client.put("pan", &packed("pan")).status, 201);
    let references: Vec<String> = files(&fixture("pan/reference"))
        .values()
        .map(|bytes| put(&client, bytes))
        .collect();
    let images = |hashes: &[String]| -> Value {
        hashes
            .iter()
            .enumerate()
            .map(|(index, hash)| (index.to_string(), json!(hash)))
            .collect::<serde_json::Map<_, _>>()
            .into()
    };
    let job = |hashes: &[String]| {
        json!({"sequence": "pan", "metrics": ["psnr", "ssim", "flicker"], "commit": "c1", "frames": hashes.len(),
               "outputs": {"system": "engine", "images": images(hashes), "environment": {"adapter": {"name": "RTX"}}}})
    };
    let id = client.start_job(&job(&references));
    let done = client.wait_for(id, &["done", "failed"]);
    assert_eq!(done["status"], "done", "{done}");
    let report = &done["reports"][0];
    assert_eq!(
        (&report["values"]["psnr"], &report["values"]["ssim"]),
        (&json!("inf"), &json!(1.0)),
        "equal images"
    );
    assert_eq!(
        (&report["kind"], &report["preset"], &report["adapter"]["name"]),
        (&json!("external"), &json!("engine"), &json!("RTX"))
    );
    let frames = client.get(&format!("/reports/{}/frames", report["id"])).json();
    assert_eq!(
        (&frames["frames"][0]["warmup"], &frames["frames"][0]["reset"]),
        (&json!(true), &json!(true))
    );
    assert_eq!(
        client
            .get(&format!("/reports/{}/frames/3/output.png", report["id"]))
            .status,
        200
    );

    // As a display is sent them, to half a code.
    let png = |frame: usize| client.get(&format!("/reports/{}/frames/{frame}/output.png", report["id"]));
    let shown: Vec<String> = (0..3).map(|frame| put(&client, &png(frame).body)).collect();
    let id = client.start_job(&job(&shown));
    let done = client.wait_for(id, &["done", "failed"]);
    let codes = &done["reports"][0];
    assert!(codes["values"]["psnr"].as_f64().unwrap() > 55.0, "{done}");
    assert!(
        codes["notes"][0].as_str().unwrap().contains("what a display is sent"),
        "{done}"
    );

    // The frames a step late are not the reference.
    let mut late = references.clone();
    late.rotate_right(1);
    let id = client.start_job(&job(&late));
    let done = client.wait_for(id, &["done", "failed"]);
    let psnr = done["reports"][0]["values"]["psnr"].as_f64().unwrap();
    assert!((5.0..40.0).contains(&psnr), "{done}");

    let wrong = put(&client, b"no image");
    let id = client.start_job(&job(&[wrong]));
    let failed = client.wait_for(id, &["done", "failed"]);
    assert_eq!(
        (&failed["status"], &failed["error"]["kind"]),
        (&json!("failed"), &json!("input")),
        "{failed}"
    );

    let refused = client.post_job(&job(&["0".repeat(64)]));
    refused.is_problem(422, "missing_blobs", Some("outputs.images"), "put them");
    let mut both = job(&references);
    both["presets"] = json!(["ema"]);
    client
        .post_job(&both)
        .is_problem(422, "invalid_field", Some("presets"), "not both");
    // What is missing is no smaller sequence, unless that is said; then it is a line of its own.
    let mut gap = job(&references);
    gap["outputs"]["images"].as_object_mut().unwrap().remove("11");
    client.post_job(&gap).is_problem(
        422,
        "invalid_field",
        Some("outputs.images"),
        "1 of the frames 0 to 11 have no image",
    );
    let first = client.start_job(&job(&references[..3]));
    let first = client.wait_for(first, &["done", "failed"]);
    assert_eq!(
        (&report["n_frames"], &first["reports"][0]["n_frames"]),
        (&json!(null), &json!(3))
    );
    assert_ne!(report["series_id"], first["reports"][0]["series_id"]);
    gap["outputs"]["images"]["99"] = json!(references[0]);
    client.post_job(&gap).is_problem(
        422,
        "invalid_field",
        Some("outputs.images"),
        "`99` is none of the frames",
    );
}
