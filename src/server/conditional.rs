//! `ETag` and `If-None-Match`: a client that polls is sent what it does not have. The tag is a hash of the content, weak
//! because compression may follow.

use crate::hex::hex;
use axum::{
    body::{Body, HttpBody as _, to_bytes},
    http::{HeaderMap, HeaderValue, Method, Request, StatusCode, header},
    middleware::Next,
    response::{IntoResponse as _, Response},
};
use sha2::{Digest as _, Sha256};

/// What is larger is sent as it comes.
const MAX_TAGGED_BYTES: u64 = 8 << 20;

/// Tags answers, and leaves out what the client has.
pub async fn tag(request: Request<Body>, next: Next) -> Response {
    let wanted = request.method() == Method::GET;
    let has = request.headers().get(header::IF_NONE_MATCH).cloned();
    let response = next.run(request).await;
    let length = response.body().size_hint().exact();
    let is_tagged = response.headers().contains_key(header::ETAG);
    if !wanted || response.status() != StatusCode::OK || is_tagged || length.is_none_or(|n| n > MAX_TAGGED_BYTES) {
        return response;
    }
    let (mut parts, body) = response.into_parts();
    let Ok(bytes) = to_bytes(body, MAX_TAGGED_BYTES as usize).await else {
        return StatusCode::INTERNAL_SERVER_ERROR.into_response();
    };
    let tag = format!("W/\"{}\"", hex(&Sha256::digest(&bytes)[..12]));
    if let Ok(value) = HeaderValue::from_str(&tag) {
        parts.headers.insert(header::ETAG, value);
    }
    if has.is_some_and(|has| names(&has, &tag)) {
        parts.status = StatusCode::NOT_MODIFIED;
        let kept = [header::ETAG, header::CACHE_CONTROL, header::VARY];
        let headers = std::mem::take(&mut parts.headers);
        parts.headers = headers
            .into_iter()
            .filter_map(|(name, value)| Some((name?, value)))
            .filter(|(name, _)| kept.contains(name))
            .collect::<HeaderMap>();
        return Response::from_parts(parts, Body::empty());
    }
    Response::from_parts(parts, Body::from(bytes))
}

/// Whether a list of tags has this one; whether tags are weak does not matter here.
fn names(list: &HeaderValue, tag: &str) -> bool {
    let bare = |text: &str| text.trim().trim_start_matches("W/").to_owned();
    list.to_str()
        .is_ok_and(|list| list.trim() == "*" || list.split(',').any(|one| bare(one) == bare(tag)))
}
