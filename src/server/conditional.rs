//! `ETag` and `If-None-Match`: a client that polls is sent what it does not have. The tag is a hash of the content, weak
//! because compression may follow.

use super::{
    Service,
    answers::{Answer, FromStore, Question},
};
use crate::hex::hex;
use axum::{
    body::{Body, HttpBody as _, to_bytes},
    extract::State,
    http::{HeaderValue, Method, Request, StatusCode, header},
    middleware::Next,
    response::{IntoResponse as _, Response},
};
use sha2::{Digest as _, Sha256};
use std::sync::Arc;

/// What is larger is sent as it comes.
const MAX_TAGGED_BYTES: u64 = 8 << 20;

/// Tags answers, keeps those that may be kept, and leaves out what the client has.
pub async fn tag(State(service): State<Arc<Service>>, request: Request<Body>, next: Next) -> Response {
    if request.method() != Method::GET {
        return next.run(request).await;
    }
    let has = request.headers().get(header::IF_NONE_MATCH).cloned();
    let question = Question::of(&request);
    let state = service.store.state();
    if let Some(kept) = service.answers.get(state, &question) {
        return send(kept, has);
    }
    let response = next.run(request).await;
    let length = response.body().size_hint().exact();
    let is_tagged = response.headers().contains_key(header::ETAG);
    if response.status() != StatusCode::OK || is_tagged || length.is_none_or(|n| n > MAX_TAGGED_BYTES) {
        return response;
    }
    let (mut parts, body) = response.into_parts();
    let Ok(body) = to_bytes(body, MAX_TAGGED_BYTES as usize).await else {
        return StatusCode::INTERNAL_SERVER_ERROR.into_response();
    };
    let tag = format!("W/\"{}\"", hex(&Sha256::digest(&body)[..12]));
    if let Ok(value) = HeaderValue::from_str(&tag) {
        parts.headers.insert(header::ETAG, value);
    }
    let answer = Answer {
        headers: parts.headers,
        body,
    };
    if let Some(&kind) = parts.extensions.get::<FromStore>() {
        service.answers.keep(state, kind, question, &answer);
    }
    send(answer, has)
}

/// The answer, or that the client has it.
fn send(answer: Answer, has: Option<HeaderValue>) -> Response {
    let Answer { mut headers, body } = answer;
    let is_known = |has: &HeaderValue| headers.get(header::ETAG).is_some_and(|tag| names(has, tag));
    if has.as_ref().is_some_and(is_known) {
        let kept = [header::ETAG, header::CACHE_CONTROL, header::VARY];
        headers = headers
            .into_iter()
            .filter_map(|(name, value)| Some((name?, value)))
            .filter(|(name, _)| kept.contains(name))
            .collect();
        return (StatusCode::NOT_MODIFIED, headers).into_response();
    }
    let mut response = Response::new(Body::from(body));
    *response.headers_mut() = headers;
    response
}

/// Whether a list of tags has this one; whether tags are weak does not matter here.
fn names(list: &HeaderValue, tag: &HeaderValue) -> bool {
    let bare = |text: &str| text.trim().trim_start_matches("W/").to_owned();
    let tag = bare(tag.to_str().unwrap_or_default());
    list.to_str()
        .is_ok_and(|list| list.trim() == "*" || list.split(',').any(|one| bare(one) == tag))
}
