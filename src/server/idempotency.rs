//! `Idempotency-Key`: a client that did not hear the answer sends the same request again, and it is done once. Answers of
//! requests that succeeded are kept for a day, by token and key: of posted results in the transaction that stores them, of
//! others behind it.

use super::{ApiError, Caller, Service, extract::body_error};
use crate::store::{Keep, KeptAnswer};
use axum::{
    body::{Body, Bytes, to_bytes},
    extract::{FromRequest as _, FromRequestParts, State},
    http::{HeaderName, HeaderValue, Method, Request, StatusCode, header, request::Parts},
    middleware::Next,
    response::{IntoResponse as _, Response},
};
use serde::Serialize;
use sha2::{Digest as _, Sha256};
use std::{
    collections::HashMap,
    convert::Infallible,
    sync::{
        Arc, Mutex, PoisonError,
        atomic::{AtomicBool, Ordering::Relaxed},
    },
    time::Duration,
};

const KEY: HeaderName = HeaderName::from_static("idempotency-key");
const REPLAYED: HeaderName = HeaderName::from_static("idempotency-replayed");
/// Headers that an answer that is given again has too.
const KEPT_HEADERS: [HeaderName; 2] = [header::CONTENT_TYPE, header::LOCATION];
/// Larger answers than any POST gives.
const MAX_ANSWER_BYTES: usize = 16 << 20;

/// Requests with a key that are being done right now, by token and key, with the fingerprint of each.
#[derive(Default)]
pub struct InProgress(Mutex<HashMap<(i64, String), [u8; 32]>>);

/// Kept as the status of a request whose result is stored and whose answer is still to be found; its body lists the reports.
const STORED: u16 = StatusCode::PROCESSING.as_u16();

/// A request's key.
struct Key {
    token_id: i64,
    key: String,
    fingerprint: [u8; 32],
    /// The reports that an earlier try has stored.
    stored: Option<Vec<i64>>,
    is_kept: AtomicBool,
}

/// The key of a request that has one, for handlers whose answer is known when their result is stored.
pub struct Keyed(Option<Arc<Key>>);

impl<S: Send + Sync> FromRequestParts<S> for Keyed {
    type Rejection = Infallible;

    async fn from_request_parts(parts: &mut Parts, _: &S) -> Result<Self, Infallible> {
        Ok(Self(parts.extensions.get().cloned()))
    }
}

impl Keyed {
    /// The reports that an earlier try of the request has stored, whose answer is still to be found.
    pub fn stored(&self) -> Option<&[i64]> {
        self.0.as_ref()?.stored.as_deref()
    }

    /// Keeps the answer with the result: status, location and body, by the numbers of the reports.
    pub fn keep<T: Serialize>(
        &self,
        answer: impl Fn(&[i64]) -> (StatusCode, Option<String>, T) + Send + Sync + 'static,
    ) -> Option<Keep> {
        self.0.as_ref()?.is_kept.store(true, Relaxed);
        self.keep_as(move |ids| {
            let (status, location, body) = answer(ids);
            let mut headers = vec![(header::CONTENT_TYPE.to_string(), "application/json".to_owned())];
            headers.extend(location.map(|location| (header::LOCATION.to_string(), location)));
            let body = serde_json::to_vec(&body).unwrap_or_default();
            (status.as_u16(), headers, body)
        })
    }

    /// Keeps with the result that it is stored. The answer, which is found afterwards, replaces that.
    pub fn keep_stored(&self) -> Option<Keep> {
        self.keep_as(|ids| (STORED, Vec::new(), serde_json::to_vec(ids).unwrap_or_default()))
    }

    fn keep_as(
        &self,
        answer: impl Fn(&[i64]) -> (u16, Vec<(String, String)>, Vec<u8>) + Send + Sync + 'static,
    ) -> Option<Keep> {
        let key = self.0.as_ref()?;
        let fingerprint = key.fingerprint;
        Some(Keep {
            token_id: key.token_id,
            key: key.key.clone(),
            answer: Box::new(move |ids| {
                let (status, headers, body) = answer(ids);
                KeptAnswer {
                    fingerprint,
                    status,
                    headers,
                    body,
                }
            }),
        })
    }
}

/// Ends with the request, however that ends.
struct Mark<'a> {
    all: &'a InProgress,
    key: (i64, String),
}

impl Drop for Mark<'_> {
    fn drop(&mut self) {
        self.all.lock().remove(&self.key);
    }
}

impl InProgress {
    fn lock(&self) -> std::sync::MutexGuard<'_, HashMap<(i64, String), [u8; 32]>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn begin(&self, key: (i64, String), fingerprint: [u8; 32]) -> Result<Mark<'_>, ApiError> {
        let mut all = self.lock();
        match all.get(&key) {
            Some(other) if *other == fingerprint => {
                let detail = "a request with this key is being done; ask again in a moment";
                let error = ApiError::new(StatusCode::CONFLICT, "request_in_progress", detail);
                Err(error.retry_after(Duration::from_secs(1)))
            }
            Some(_) => Err(other_request()),
            None => {
                all.insert(key.clone(), fingerprint);
                Ok(Mark { all: self, key })
            }
        }
    }
}

fn other_request() -> ApiError {
    let detail = "this key was used for another request; every request needs a key of its own";
    ApiError::invalid("idempotency_key_reused", detail).field("idempotency-key")
}

/// Does a request with a key once.
pub async fn once(State(service): State<Arc<Service>>, caller: Caller, request: Request<Body>, next: Next) -> Response {
    if request.method() != Method::POST || !request.headers().contains_key(&KEY) {
        return next.run(request).await;
    }
    match keyed(&service, &caller, request, next).await {
        Ok(response) => response,
        Err(error) => error.into_response(),
    }
}

async fn keyed(service: &Service, caller: &Caller, request: Request<Body>, next: Next) -> Result<Response, ApiError> {
    let key = request.headers()[&KEY].to_str().unwrap_or_default().to_owned();
    if !(1..=200).contains(&key.len()) || !key.bytes().all(|byte| byte.is_ascii_graphic()) {
        let detail = "an idempotency key has 1 to 200 printable ASCII characters without spaces";
        return Err(ApiError::new(StatusCode::BAD_REQUEST, "bad_idempotency_key", detail).field("idempotency-key"));
    }
    let (parts, body) = request.into_parts();
    let body = Bytes::from_request(Request::from_parts(parts.clone(), body), &())
        .await
        .map_err(body_error)?;
    let fingerprint = fingerprint(&parts.uri.to_string(), &body);
    let key = (caller.token_id, key);
    let _mark = service.in_progress.begin(key.clone(), fingerprint)?;
    let stored = match service.store.kept_answer(key.0, &key.1).await? {
        None => None,
        Some(kept) if kept.fingerprint != fingerprint => return Err(other_request()),
        Some(kept) if kept.status != STORED => return Ok(replay(kept)),
        Some(kept) => Some(serde_json::from_slice(&kept.body).map_err(ApiError::internal)?),
    };
    let mut request = Request::from_parts(parts, Body::from(body));
    let kept = Arc::new(Key {
        token_id: key.0,
        key: key.1.clone(),
        fingerprint,
        stored,
        is_kept: AtomicBool::new(false),
    });
    request.extensions_mut().insert(Arc::clone(&kept));
    let response = next.run(request).await;
    // Where nothing was done, a client may correct its request and keep the key.
    if !response.status().is_success() || kept.is_kept.load(Relaxed) {
        return Ok(response);
    }
    let (parts, body) = response.into_parts();
    let body = to_bytes(body, MAX_ANSWER_BYTES).await.map_err(ApiError::internal)?;
    let headers = KEPT_HEADERS
        .iter()
        .filter_map(|name| Some((name.to_string(), parts.headers.get(name)?.to_str().ok()?.to_owned())))
        .collect();
    let answer = KeptAnswer {
        fingerprint,
        status: parts.status.as_u16(),
        headers,
        body: body.to_vec(),
    };
    service.store.ingest().keep(key.0, key.1, answer).await?;
    Ok(Response::from_parts(parts, Body::from(body)))
}

fn fingerprint(address: &str, body: &Bytes) -> [u8; 32] {
    let mut hash = Sha256::new();
    hash.update(address.as_bytes());
    hash.update([0]);
    hash.update(body);
    hash.finalize().into()
}

fn replay(kept: KeptAnswer) -> Response {
    let status = StatusCode::from_u16(kept.status).unwrap_or(StatusCode::OK);
    let mut response = (status, kept.body).into_response();
    let headers = response.headers_mut();
    headers.remove(header::CONTENT_TYPE);
    for (name, value) in kept.headers {
        if let (Ok(name), Ok(value)) = (HeaderName::try_from(name), HeaderValue::try_from(value)) {
            headers.insert(name, value);
        }
    }
    headers.insert(REPLAYED, HeaderValue::from_static("true"));
    response
}
