//! `GET /sequences`, `GET /sequences/{hash or name}`, `POST /sequences` from blobs, and a sequence as a tar.

use super::{
    ApiError, ApiPath, ApiQuery, Service, Shared, blobs, blocking,
    extract::ApiJson,
    page::{self, Cursor},
    upload,
};
use crate::store::{Check, Sequence, Timestamp};
use axum::{
    Json,
    body::{Body, Bytes},
    extract::State,
    http::{StatusCode, header},
    response::IntoResponse,
};
use futures_util::stream;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::{collections::BTreeMap, fs, io, sync::Arc};
use tokio::sync::mpsc;

/// The sequence that a path or a field names.
pub async fn find(service: &Service, hash_or_name: &str) -> Result<Sequence, ApiError> {
    let found = service.store.sequence(hash_or_name).await?;
    found.ok_or_else(|| {
        ApiError::not_found(format!(
            "there is no sequence `{hash_or_name}`; put it under /api/v1/sequences/<name>, or see /api/v1/sequences"
        ))
    })
}

/// The sequence that a body's field `sequence` names.
pub async fn named_in_body(service: &Service, hash_or_name: &str) -> Result<Sequence, ApiError> {
    find(service, hash_or_name).await.map_err(|error| match error.status() {
        StatusCode::NOT_FOUND => ApiError::invalid("unknown_sequence", error.detail()).field("sequence"),
        _ => error,
    })
}

/// Query of `GET /sequences`.
#[derive(Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SequenceQuery {
    /// The `next_cursor` of the page before.
    cursor: Option<Cursor>,
    /// At most so many, 1 to 1000; 50 where left out.
    #[schemars(range(min = 1, max = 1000))]
    limit: Option<u32>,
}

/// A page of sequences.
#[derive(Serialize, JsonSchema)]
pub struct SequencePage {
    /// Newest content first, without manifests.
    sequences: Vec<Sequence>,
    /// Where the next page begins; none after the last.
    next_cursor: Option<Cursor>,
}

/// Sequences a page at a time, without manifests.
pub async fn list(
    State(service): Shared,
    ApiQuery(query): ApiQuery<SequenceQuery>,
) -> Result<Json<SequencePage>, ApiError> {
    let limit = page::limit(query.limit)?;
    let before = query.cursor.map(|cursor| cursor.0);
    let sequences = service.store.sequence_page(before, limit).await?;
    let next_cursor = page::next(&sequences, limit, |sequence| sequence.id);
    Ok(Json(SequencePage { sequences, next_cursor }))
}

/// A sequence, and what the convention check says of it.
#[derive(Serialize, JsonSchema)]
pub struct Checked {
    #[serde(flatten)]
    sequence: Sequence,
    /// What the convention check says of it.
    check: Check,
}

/// One sequence with its manifest and its check.
pub async fn get(State(service): Shared, ApiPath(name): ApiPath<String>) -> Result<Json<Checked>, ApiError> {
    let sequence = find(&service, &name).await?;
    let check = service.store.check(sequence.id).await?;
    Ok(Json(Checked { sequence, check }))
}

/// The body of `POST /sequences`.
#[derive(Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SequenceRequest {
    /// The name to find it by.
    #[schemars(length(min = 1, max = 100), regex(pattern = "^[A-Za-z0-9_.-]+$"))]
    name: String,
    /// The manifest, as `manifest.json` would have it.
    manifest: serde_json::Map<String, serde_json::Value>,
    /// SHA-256 of each file that the manifest refers to, by its path there. The blobs must have been put.
    #[schemars(extend("minProperties" = 1, "maxProperties" = 200_000))]
    files: BTreeMap<String, String>,
}

/// Makes a sequence of blobs: 201 if its content is new, 200 if it is known.
pub async fn post(
    State(service): Shared,
    ApiJson(request): ApiJson<SequenceRequest>,
) -> Result<impl IntoResponse, ApiError> {
    upload::check_name(&request.name)?;
    let missing: Vec<String> = request
        .files
        .values()
        .filter(|hash| blobs::check_hash(hash).is_err() || !service.folder.blob(hash).is_file())
        .cloned()
        .collect();
    if !missing.is_empty() {
        let detail = format!(
            "{} blobs are not here; put them under /api/v1/blobs/<sha256> first",
            missing.len()
        );
        return Err(ApiError::invalid("missing_blobs", detail)
            .field("files")
            .missing(missing));
    }
    let assembling = Arc::clone(&service);
    let sequence = blocking(move || assemble(&assembling, &request)).await??;
    let (stored, new) = service.store.put_sequence(&sequence, Timestamp::now()).await?;
    service.wake_checker.notify_one();
    let status = if new { StatusCode::CREATED } else { StatusCode::OK };
    let location = [(header::LOCATION, format!("/api/v1/sequences/{}", stored.hash))];
    Ok((status, location, Json(stored)))
}

/// Links blobs to where the manifest expects files.
fn assemble(service: &Service, request: &SequenceRequest) -> Result<crate::store::NewSequence, ApiError> {
    let scratch = tempfile::tempdir_in(service.folder.spool()).map_err(ApiError::internal)?;
    let folder = scratch.path().join("sequence");
    fs::create_dir(&folder).map_err(ApiError::internal)?;
    let manifest = serde_json::to_vec_pretty(&request.manifest).map_err(ApiError::internal)?;
    fs::write(folder.join("manifest.json"), manifest).map_err(ApiError::internal)?;
    for (name, hash) in &request.files {
        let is_plain = name.split('/').all(|part| !matches!(part, "" | "." | ".."));
        if !is_plain || name.len() > 1000 || name.contains('\0') || name == "manifest.json" {
            let detail = format!("`{name}` must be a relative path without `.` and `..`, and not the manifest's");
            return Err(ApiError::invalid("invalid_field", detail).field("files"));
        }
        let place = folder.join(name);
        let linked = fs::create_dir_all(place.parent().unwrap_or(&folder))
            .and_then(|()| fs::hard_link(service.folder.blob(hash), &place));
        linked.map_err(|error| match error.kind() {
            io::ErrorKind::NotADirectory | io::ErrorKind::AlreadyExists | io::ErrorKind::InvalidFilename => {
                ApiError::invalid("invalid_field", format!("`{name}` is in another file's way")).field("files")
            }
            _ => ApiError::internal(error),
        })?;
    }
    upload::adopt(service, &request.name, &folder)
}

/// `GET /sequences/{sequence}/archive`: a tar, made while it is sent.
pub async fn archive(State(service): Shared, ApiPath(name): ApiPath<String>) -> Result<impl IntoResponse, ApiError> {
    let stored = find(&service, &name).await?;
    let folder = service.folder.sequence(&stored.hash);
    let sequence = crate::sequence::Sequence::open(&folder, &service.reader).map_err(ApiError::internal)?;
    // A client that reads slowly makes the writer wait; one that leaves ends it.
    let (chunks, receiver) = mpsc::channel::<io::Result<Bytes>>(4);
    tokio::task::spawn_blocking(move || {
        let mut pipe = io::BufWriter::with_capacity(256 * 1024, Pipe(chunks.clone()));
        let packed = sequence
            .pack(&mut pipe)
            .map_err(io::Error::other)
            .and_then(|()| io::Write::flush(&mut pipe));
        if let Err(error) = packed {
            // The connection is cut, so that nobody takes half an archive for a whole one.
            let _ = chunks.blocking_send(Err(error));
        }
    });
    let body = stream::unfold(receiver, async |mut receiver| Some((receiver.recv().await?, receiver)));
    let headers = [
        (header::CONTENT_TYPE, "application/x-tar".to_owned()),
        (
            header::CONTENT_DISPOSITION,
            format!("attachment; filename=\"{}.tar\"", stored.name),
        ),
    ];
    Ok((headers, Body::from_stream(body)))
}

/// Writes into a channel.
struct Pipe(mpsc::Sender<io::Result<Bytes>>);

impl io::Write for Pipe {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let sent = self.0.blocking_send(Ok(Bytes::copy_from_slice(bytes)));
        sent.map_err(|_| io::ErrorKind::BrokenPipe.into()).map(|()| bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}
