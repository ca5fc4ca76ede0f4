//! `PUT /sequences/{name}`: a tar, tar.gz or zip of a sequence's folder. It is streamed to the spool, unpacked within
//! limits, checked and hashed, and only then moved into place and stored: a refused upload leaves nothing.

use super::{ApiError, ApiPath, Service, Shared, blocking, origin::is_name};
use crate::{
    sequence::{ManifestError, Sequence, SequenceError, archive},
    store::{NewSequence, Timestamp},
};
use axum::{
    Json,
    body::{Body, BodyDataStream},
    extract::State,
    http::{HeaderName, StatusCode, header},
    response::IntoResponse,
};
use futures_util::StreamExt as _;
use std::{error::Error, io, path::Path, sync::Arc};
use tempfile::NamedTempFile;
use tokio::{fs::File, io::AsyncWriteExt as _};

const MIB: u64 = 1024 * 1024;

/// Stores the sequence: 201 if its content is new, 200 if it is known (and now found by this name).
pub async fn put(
    State(service): Shared,
    ApiPath(name): ApiPath<String>,
    body: Body,
) -> Result<impl IntoResponse, ApiError> {
    check_name(&name)?;
    let spooled = NamedTempFile::new_in(service.folder.spool()).map_err(ApiError::internal)?;
    spool(
        body.into_data_stream(),
        spooled.path(),
        service.config.max_archive_mib * MIB,
    )
    .await?;
    let unpacking = Arc::clone(&service);
    let sequence = blocking(move || unpack(&unpacking, &name, spooled)).await??;
    let (stored, new) = service.store.put_sequence(&sequence, Timestamp::now()).await?;
    tracing::info!(name = stored.name, hash = stored.hash, new, "sequence put");
    service.wake_checker.notify_one();
    let status = if new { StatusCode::CREATED } else { StatusCode::OK };
    let location: [(HeaderName, String); 1] = [(header::LOCATION, format!("/api/v1/sequences/{}", stored.hash))];
    Ok((status, location, Json(stored)))
}

/// A sequence's name must not be taken for a hash.
pub fn check_name(name: &str) -> Result<(), ApiError> {
    let like_a_hash = name.len() == 64 && name.bytes().all(|byte| byte.is_ascii_hexdigit());
    if is_name(name) && !like_a_hash {
        return Ok(());
    }
    let detail =
        "a sequence's name has 1 to 100 letters, digits, `-`, `_` or `.`, and is neither a content hash nor only dots";
    Err(ApiError::invalid("invalid_name", detail).field("name"))
}

/// Writes the body to a file, and stops as soon as it is too long.
async fn spool(mut body: BodyDataStream, path: &Path, max_bytes: u64) -> Result<(), ApiError> {
    let mut file = File::create(path).await.map_err(ApiError::internal)?;
    let mut n_bytes = 0;
    while let Some(chunk) = body.next().await {
        let chunk = chunk.map_err(|error| {
            ApiError::new(
                StatusCode::BAD_REQUEST,
                "upload_broken",
                format!("the upload broke off: {error}"),
            )
        })?;
        n_bytes += chunk.len() as u64;
        if n_bytes > max_bytes {
            let detail = format!("the archive is larger than {} MiB (--max-archive-mib)", max_bytes / MIB);
            return Err(ApiError::new(
                StatusCode::PAYLOAD_TOO_LARGE,
                "archive_too_large",
                detail,
            ));
        }
        file.write_all(&chunk).await.map_err(ApiError::internal)?;
    }
    file.flush().await.map_err(ApiError::internal)
}

/// Unpacks, checks and hashes an archive, and moves the sequence into place.
fn unpack(service: &Service, name: &str, archive: NamedTempFile) -> Result<NewSequence, ApiError> {
    let scratch = tempfile::tempdir_in(service.folder.spool()).map_err(ApiError::internal)?;
    let folder = scratch.path().join("sequence");
    // The user knows paths inside the archive; ours would only confuse.
    let archive_path = archive.path().display().to_string();
    let relative = |error: &dyn Error| error.to_string().replace(&archive_path, "the archive");
    let limits = archive::Limits {
        max_bytes: service.config.max_sequence_mib * MIB,
        ..archive::Limits::default()
    };
    archive::extract(archive.path(), &folder, limits)
        .map_err(|error| ApiError::invalid("invalid_archive", relative(&error)))?;
    drop(archive);
    adopt(service, name, &folder)
}

/// Checks and hashes a sequence's folder in the spool, and moves it into place.
pub fn adopt(service: &Service, name: &str, folder: &Path) -> Result<NewSequence, ApiError> {
    let folder_prefix = format!("{}/", folder.display());
    let relative = |error: &dyn Error| error.to_string().replace(&folder_prefix, "");
    let invalid = |error: SequenceError| {
        let problem = ApiError::invalid("invalid_sequence", relative(&error));
        match error {
            SequenceError::Manifest {
                problem: ManifestError::Field { field, .. },
                ..
            } => problem.field(field),
            _ => problem,
        }
    };
    let sequence = Sequence::open(folder, &service.reader).map_err(invalid)?;
    sequence.verify_files().map_err(invalid)?;
    let stored = NewSequence {
        hash: sequence.hash().map_err(invalid)?,
        name: name.to_owned(),
        manifest: sequence.manifest_json(),
        render_size: sequence.render_size(),
        output_size: sequence.output_size(),
        n_frames: sequence.n_frames(),
        n_bytes: folder_size(folder).map_err(ApiError::internal)?,
    };
    service
        .folder
        .adopt_sequence(folder, &stored.hash)
        .map_err(ApiError::internal)?;
    Ok(stored)
}

/// Bytes of all files under `folder`.
fn folder_size(folder: &Path) -> io::Result<u64> {
    let mut n_bytes = 0;
    for entry in std::fs::read_dir(folder)? {
        let entry = entry?;
        let metadata = entry.metadata()?;
        n_bytes += if metadata.is_dir() {
            folder_size(&entry.path())?
        } else {
            metadata.len()
        };
    }
    Ok(n_bytes)
}
