//! Connections that close after an answer are said to: a pool would give the next request to one that is gone.

use axum::{
    body::{Body, HttpBody as _},
    extract::Request,
    http::{HeaderValue, header},
    middleware::Next,
    response::Response,
};
use futures_util::{StreamExt as _, stream};
use std::{
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering::Relaxed},
    },
    task::Poll,
};

/// Adds `connection: close` where an answer was given before the whole request was read: what is left of it cannot be told from
/// the next one, so that the connection ends.
pub async fn tell(request: Request, next: Next) -> Response {
    if request.body().is_end_stream() {
        return next.run(request).await;
    }
    let is_read = Arc::new(AtomicBool::new(false));
    let note = Arc::clone(&is_read);
    let watched = request.map(|body| {
        let mut data = body.into_data_stream();
        Body::from_stream(stream::poll_fn(move |context| {
            let polled = data.poll_next_unpin(context);
            if matches!(polled, Poll::Ready(None)) {
                note.store(true, Relaxed);
            }
            polled
        }))
    });
    let mut response = next.run(watched).await;
    if !is_read.load(Relaxed) {
        let close = HeaderValue::from_static("close");
        response.headers_mut().insert(header::CONNECTION, close);
    }
    response
}
