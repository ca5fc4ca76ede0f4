//! `GET /jobs/{id}/events`: a job's progress as server-sent events. The first event says where the job stands, the last
//! is its end: `progress`, then one of `done`, `failed`, `cancelled`. The data of each is the job as `GET /jobs/{id}`
//! gives it, without reports. Each event's id says which state it tells, so that a client that lost the connection and
//! sends `Last-Event-ID` is not told again what it knows; after the end that is 204, which ends an `EventSource`.

use super::{ApiError, ApiPath, Service, Shared};
use crate::{
    store::{Job, Status},
    worker::JobEvent,
};
use axum::{
    extract::State,
    http::{HeaderMap, StatusCode},
    response::{
        IntoResponse as _, Response,
        sse::{Event, KeepAlive, Sse},
    },
};
use futures_util::stream::{self, StreamExt as _};
use std::{convert::Infallible, sync::Arc};
use tokio::sync::broadcast::{Receiver, error::RecvError};

struct Watch {
    service: Arc<Service>,
    events: Receiver<JobEvent>,
    job: Arc<Job>,
    /// What is to be sent next; the end follows when there is nothing.
    next: Next,
}

enum Next {
    Current,
    Change,
    End,
}

/// Follows a job until it ends, the client leaves or the service stops.
pub async fn follow(
    State(service): Shared,
    ApiPath(id): ApiPath<i64>,
    headers: HeaderMap,
) -> Result<Response, ApiError> {
    // Subscribed before the job is read: a change between the two is seen twice rather than never.
    let events = service.events.subscribe();
    let job = service.store.job(id).await?;
    let job = job.ok_or_else(|| ApiError::not_found(format!("there is no job {id}")))?;
    let stopped = service.shutdown.clone().cancelled_owned();
    let last = headers.get("last-event-id").and_then(|id| id.to_str().ok());
    let knows = last == Some(event_id(&job).as_str());
    if knows && job.status.is_final() {
        return Ok(StatusCode::NO_CONTENT.into_response());
    }
    let watch = Watch {
        service,
        events,
        job,
        next: if knows { Next::Change } else { Next::Current },
    };
    let stream = stream::unfold(watch, Watch::step).take_until(Box::pin(stopped));
    Ok(Sse::new(stream).keep_alive(KeepAlive::default()).into_response())
}

/// Names a state of a job.
fn event_id(job: &Job) -> String {
    let status = format!("{:?}", job.status).to_lowercase();
    format!("{status}-{}-{}-{}", job.attempts, job.n_done, job.n_total)
}

impl Watch {
    async fn step(mut self) -> Option<(Result<Event, Infallible>, Self)> {
        match self.next {
            Next::End => return None,
            Next::Current => {}
            Next::Change => self.change().await?,
        }
        self.next = if self.job.status.is_final() {
            Next::End
        } else {
            Next::Change
        };
        let name = match self.job.status {
            Status::Queued | Status::Running => "progress",
            Status::Done => "done",
            Status::Failed => "failed",
            Status::Cancelled => "cancelled",
        };
        let event = Event::default()
            .id(event_id(&self.job))
            .event(name)
            .json_data(&self.job);
        // A job is plain data; it was read from JSON.
        Some((Ok(event.unwrap_or_default()), self))
    }

    /// Waits until the job changes. Progress comes with the event; anything else is read from the store, also when
    /// this watcher was too slow to hear every event.
    async fn change(&mut self) -> Option<()> {
        loop {
            match self.events.recv().await {
                Ok(event) if event.job_id != self.job.id => {}
                Ok(event) if event.status == Status::Running && self.job.status == Status::Running => {
                    let (n_done, n_total) = (event.n_done as i64, event.n_total as i64);
                    if (n_done, n_total) == (self.job.n_done, self.job.n_total) {
                        continue;
                    }
                    let job = Arc::make_mut(&mut self.job);
                    (job.n_done, job.n_total) = (n_done, n_total);
                    return Some(());
                }
                Ok(_) | Err(RecvError::Lagged(_)) => {
                    self.job = self.service.store.job(self.job.id).await.ok()??;
                    return Some(());
                }
                Err(RecvError::Closed) => return None,
            }
        }
    }
}
