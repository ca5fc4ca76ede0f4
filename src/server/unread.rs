//! What is left of a request that was answered before it was read. Where it is little, it is read now and the connection goes on;
//! else the connection closes and is said to: a pool would give the next request to one that is gone.

use axum::{
    body::{Body, HttpBody as _},
    extract::Request,
    http::{HeaderValue, header},
    middleware::Next,
    response::Response,
};
use futures_util::{StreamExt as _, stream};
use std::{
    sync::{Arc, Mutex, PoisonError},
    task::Context,
    time::Duration,
};

/// More than this is not waited for.
const MAX_BYTES: usize = 64 << 10;
/// Nor longer.
const PATIENCE: Duration = Duration::from_millis(500);

/// Reads what is left, or adds `connection: close`.
pub async fn finish(request: Request, next: Next) -> Response {
    if request.body().is_end_stream() {
        return next.run(request).await;
    }
    let (parts, body) = request.into_parts();
    // A handler reads it first, and what is left is read here.
    let data = Arc::new(Mutex::new(body.into_data_stream().fuse()));
    let poll = move |context: &mut Context<'_>| {
        let mut data = data.lock().unwrap_or_else(PoisonError::into_inner);
        data.poll_next_unpin(context)
    };
    let mut left = stream::poll_fn(poll.clone());
    let body = Body::from_stream(stream::poll_fn(poll));
    let mut response = next.run(Request::from_parts(parts, body)).await;
    let rest = async {
        let mut n_bytes = 0;
        while n_bytes <= MAX_BYTES {
            match left.next().await {
                Some(Ok(bytes)) => n_bytes += bytes.len(),
                Some(Err(_)) => return false,
                None => return true,
            }
        }
        false
    };
    if !tokio::time::timeout(PATIENCE, rest).await.unwrap_or(false) {
        let close = HeaderValue::from_static("close");
        response.headers_mut().insert(header::CONNECTION, close);
    }
    response
}
