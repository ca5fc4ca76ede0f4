//! What is left of a request that was answered before it was read. Where it is little, it is read now and the connection goes on;
//! else the connection closes and is said to: a pool would give the next request to one that is gone.

use axum::{
    body::{Body, BodyDataStream, HttpBody as _},
    extract::Request,
    http::{HeaderValue, header},
    middleware::Next,
    response::Response,
};
use futures_util::{StreamExt as _, stream};
use std::{
    future,
    sync::{Arc, Mutex, PoisonError},
    task::{Context, Poll},
    time::Duration,
};

/// More than this is not waited for.
const MAX_BYTES: usize = 64 << 10;
/// Nor longer.
const PATIENCE: Duration = Duration::from_millis(500);

/// A body that is read by a handler first and here then.
struct Shared {
    data: BodyDataStream,
    is_read: bool,
}

impl Shared {
    fn poll(&mut self, context: &mut Context<'_>) -> Poll<Option<Result<axum::body::Bytes, axum::Error>>> {
        if self.is_read {
            return Poll::Ready(None);
        }
        let polled = self.data.poll_next_unpin(context);
        self.is_read |= matches!(polled, Poll::Ready(None));
        polled
    }
}

/// Reads what is left, or adds `connection: close`.
pub async fn finish(request: Request, next: Next) -> Response {
    if request.body().is_end_stream() {
        return next.run(request).await;
    }
    let (parts, body) = request.into_parts();
    let shared = Arc::new(Mutex::new(Shared {
        data: body.into_data_stream(),
        is_read: false,
    }));
    let read = Arc::clone(&shared);
    let poll = move |context: &mut Context<'_>| read.lock().unwrap_or_else(PoisonError::into_inner).poll(context);
    let body = Body::from_stream(stream::poll_fn(poll.clone()));
    let mut response = next.run(Request::from_parts(parts, body)).await;
    let rest = async {
        let mut n_bytes = 0;
        let mut poll = poll;
        while n_bytes <= MAX_BYTES {
            match future::poll_fn(&mut poll).await {
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
