//! Files by their content: `PUT /blobs/{sha256}`. What is there is not sent again, and an upload that broke off goes on
//! where it stopped: `HEAD` says how far it got, and `Content-Range: bytes FIRST-LAST/TOTAL` sends the rest.
//! `POST /sequences` makes a sequence of blobs.

use super::{ApiError, ApiPath, Shared};
use crate::hex::hex;
use axum::{
    Json,
    body::{Body, BodyDataStream},
    extract::State,
    http::{HeaderMap, HeaderName, HeaderValue, StatusCode, header},
    response::{IntoResponse, Response},
};
use futures_util::StreamExt as _;
use schemars::JsonSchema;
use serde::Serialize;
use sha2::{Digest as _, Sha256};
use std::{io, path::Path};
use tokio::{
    fs::OpenOptions,
    io::{AsyncReadExt as _, AsyncWriteExt as _},
};

const UPLOAD_OFFSET: HeaderName = HeaderName::from_static("upload-offset");
const MIB: u64 = 1024 * 1024;

/// A stored blob.
#[derive(Serialize, JsonSchema)]
pub struct Blob {
    /// SHA-256 of its content.
    sha256: String,
    /// Its size.
    n_bytes: u64,
}

/// Hashes in paths and bodies name files, so they are what they say and nothing else.
pub fn check_hash(hash: &str) -> Result<(), ApiError> {
    let is_hash = hash.len() == 64 && hash.bytes().all(|byte| matches!(byte, b'0'..=b'9' | b'a'..=b'f'));
    let detail = "a blob is named by its SHA-256: 64 digits of 0-9 and a-f";
    is_hash
        .then_some(())
        .ok_or_else(|| ApiError::invalid("invalid_hash", detail).field("sha256"))
}

async fn length(path: &Path) -> Result<Option<u64>, ApiError> {
    match tokio::fs::metadata(path).await {
        Ok(metadata) => Ok(Some(metadata.len())),
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(None),
        Err(error) => Err(ApiError::internal(error)),
    }
}

/// `HEAD /blobs/{sha256}`: 200 where it is there; 204 with `upload-offset` where a part of it is; else 404.
pub async fn head(State(service): Shared, ApiPath(hash): ApiPath<String>) -> Result<Response, ApiError> {
    check_hash(&hash)?;
    if length(&service.folder.blob(&hash)).await?.is_some() {
        return Ok(StatusCode::OK.into_response());
    }
    match length(&service.folder.partial_blob(&hash)).await? {
        Some(offset) => Ok((StatusCode::NO_CONTENT, [(UPLOAD_OFFSET, offset)]).into_response()),
        None => Err(ApiError::not_found(format!("there is no blob {hash}"))),
    }
}

/// `PUT /blobs/{sha256}`: 201 where it is new, 200 where it was there, 202 where only a part is there yet.
pub async fn put(
    State(service): Shared,
    ApiPath(hash): ApiPath<String>,
    headers: HeaderMap,
    body: Body,
) -> Result<Response, ApiError> {
    check_hash(&hash)?;
    let (path, partial) = (service.folder.blob(&hash), service.folder.partial_blob(&hash));
    if let Some(n_bytes) = length(&path).await? {
        return Ok(Json(Blob { sha256: hash, n_bytes }).into_response());
    }
    let max_bytes = service.config.max_archive_mib * MIB;
    let range = headers
        .get(header::CONTENT_RANGE)
        .map(|value| Range::parse(value, max_bytes))
        .transpose()?;
    let _writing = service.blob_writers.begin(&hash).ok_or_else(|| {
        let detail = "somebody else is sending this blob; ask again in a moment";
        ApiError::new(StatusCode::CONFLICT, "upload_in_progress", detail).retry_after(std::time::Duration::from_secs(1))
    })?;
    let offset = length(&partial).await?.unwrap_or(0);
    if let Some(range) = &range
        && range.first != offset
        && range.first != 0
    {
        let detail = format!("{offset} bytes are here; send the rest with `content-range: bytes {offset}-…`");
        let mut response = ApiError::new(StatusCode::CONFLICT, "wrong_offset", detail).into_response();
        response.headers_mut().insert(UPLOAD_OFFSET, HeaderValue::from(offset));
        return Ok(response);
    }
    let first = range.as_ref().map_or(0, |range| range.first);
    let rest = match &range {
        Some(range) if range.first == range.total => Body::empty(),
        _ => body,
    };
    let n_bytes = append(rest.into_data_stream(), &partial, first, max_bytes).await?;
    if range.is_some_and(|range| n_bytes < range.total) {
        return Ok((StatusCode::ACCEPTED, [(UPLOAD_OFFSET, n_bytes)]).into_response());
    }
    if hash_of(&partial).await.map_err(ApiError::internal)? != hash {
        tokio::fs::remove_file(&partial).await.map_err(ApiError::internal)?;
        let detail = "the content does not have this SHA-256; nothing of it was kept";
        return Err(ApiError::invalid("wrong_hash", detail).field("sha256"));
    }
    tokio::fs::rename(&partial, &path).await.map_err(ApiError::internal)?;
    Ok((StatusCode::CREATED, Json(Blob { sha256: hash, n_bytes })).into_response())
}

/// `bytes FIRST-LAST/TOTAL`; `bytes */TOTAL` where all of them were sent before.
struct Range {
    first: u64,
    total: u64,
}

impl Range {
    fn parse(value: &HeaderValue, max_bytes: u64) -> Result<Self, ApiError> {
        let parse = || {
            let (range, total) = value.to_str().ok()?.strip_prefix("bytes ")?.split_once('/')?;
            if range == "*" {
                let total = total.parse().ok().filter(|total| *total > 0)?;
                return Some(Self { first: total, total });
            }
            let (first, last) = range.split_once('-')?;
            let (first, last, total): (u64, u64, u64) = (first.parse().ok()?, last.parse().ok()?, total.parse().ok()?);
            (first <= last && last < total).then_some(Self { first, total })
        };
        let range = parse().ok_or_else(|| {
            let detail =
                "`content-range` must be `bytes FIRST-LAST/TOTAL`, or `bytes */TOTAL` where nothing is left to send";
            ApiError::new(StatusCode::BAD_REQUEST, "bad_range", detail).field("content-range")
        })?;
        match range.total <= max_bytes {
            true => Ok(range),
            false => Err(too_large(max_bytes)),
        }
    }
}

fn too_large(max_bytes: u64) -> ApiError {
    let detail = format!("the blob is larger than {} MiB (--max-archive-mib)", max_bytes / MIB);
    ApiError::new(StatusCode::PAYLOAD_TOO_LARGE, "blob_too_large", detail)
}

/// Writes the body behind the first `first` bytes of a file. What came before an upload broke off stays.
async fn append(mut body: BodyDataStream, path: &Path, first: u64, max_bytes: u64) -> Result<u64, ApiError> {
    let mut file = OpenOptions::new()
        .create(true)
        .append(true)
        .open(path)
        .await
        .map_err(ApiError::internal)?;
    file.set_len(first).await.map_err(ApiError::internal)?;
    let mut n_bytes = first;
    let mut outcome = Ok(());
    while let Some(chunk) = body.next().await {
        let Ok(chunk) = chunk else {
            outcome = Err(ApiError::new(
                StatusCode::BAD_REQUEST,
                "upload_broken",
                "the upload broke off; go on with `content-range`",
            ));
            break;
        };
        n_bytes += chunk.len() as u64;
        if n_bytes > max_bytes {
            outcome = Err(too_large(max_bytes));
            break;
        }
        file.write_all(&chunk).await.map_err(ApiError::internal)?;
    }
    file.flush().await.map_err(ApiError::internal)?;
    // What a client was told is here survives a power cut.
    file.sync_data().await.map_err(ApiError::internal)?;
    outcome.map(|()| n_bytes)
}

async fn hash_of(path: &Path) -> io::Result<String> {
    let mut file = tokio::fs::File::open(path).await?;
    let mut hash = Sha256::new();
    let mut buffer = vec![0; 1 << 20];
    loop {
        match file.read(&mut buffer).await? {
            0 => break,
            n => hash.update(&buffer[..n]),
        }
    }
    Ok(hex(&hash.finalize()))
}

/// Blobs that are being written, so that two uploads of one never mix.
#[derive(Default)]
pub struct BlobWriters(std::sync::Mutex<std::collections::HashSet<String>>);

/// Ends with the upload.
pub struct Writing<'a>(&'a BlobWriters, String);

impl BlobWriters {
    fn lock(&self) -> std::sync::MutexGuard<'_, std::collections::HashSet<String>> {
        self.0.lock().unwrap_or_else(std::sync::PoisonError::into_inner)
    }

    fn begin(&self, hash: &str) -> Option<Writing<'_>> {
        self.lock()
            .insert(hash.to_owned())
            .then(|| Writing(self, hash.to_owned()))
    }
}

impl Drop for Writing<'_> {
    fn drop(&mut self) {
        self.0.lock().remove(&self.1);
    }
}
