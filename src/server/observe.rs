//! What operators see: a number for each request that its log lines share, counters for Prometheus, and whether the
//! service is alive and ready.

use super::{ApiError, Service, Shared};
use axum::{
    Json,
    body::Body,
    extract::{MatchedPath, State},
    http::{HeaderName, HeaderValue, Request, StatusCode, header},
    middleware::Next,
    response::{IntoResponse, Response},
};
use prometheus_client::{
    encoding::{EncodeLabelSet, text::encode},
    metrics::{counter::Counter, family::Family, gauge::Gauge, histogram::Histogram},
    registry::{Registry, Unit},
};
use serde_json::json;
use std::{
    sync::{
        Arc,
        atomic::{AtomicU64, Ordering::Relaxed},
    },
    time::Instant,
};
use tracing::Instrument as _;

const REQUEST_ID: HeaderName = HeaderName::from_static("x-request-id");

#[derive(Clone, Debug, Hash, PartialEq, Eq, EncodeLabelSet)]
struct Served {
    method: String,
    route: String,
    status: u16,
}

#[derive(Clone, Debug, Hash, PartialEq, Eq, EncodeLabelSet)]
struct Timed {
    method: String,
    route: String,
}

#[derive(Clone, Debug, Hash, PartialEq, Eq, EncodeLabelSet)]
struct ByStatus {
    status: String,
}

/// Seconds; the service's promises lie between the first and the last.
fn durations() -> Histogram {
    Histogram::new([0.001, 0.0025, 0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1.0, 2.5, 10.0])
}

/// Everything that is counted.
pub struct Counters {
    registry: Registry,
    requests: Family<Served, Counter>,
    seconds: Family<Timed, Histogram, fn() -> Histogram>,
    jobs: Family<ByStatus, Gauge>,
    waiting: Gauge,
    open_alerts: Gauge,
    next_id: AtomicU64,
    started: u64,
}

impl Counters {
    /// All zero.
    pub fn new() -> Self {
        let mut registry = Registry::with_prefix("afterimage");
        let requests = Family::<Served, Counter>::default();
        let seconds = Family::<Timed, Histogram, fn() -> Histogram>::new_with_constructor(durations);
        let jobs = Family::<ByStatus, Gauge>::default();
        let (waiting, open_alerts) = (Gauge::default(), Gauge::default());
        registry.register("http_requests", "Requests answered", requests.clone());
        registry.register_with_unit(
            "http_request_duration",
            "Time to answer",
            Unit::Seconds,
            seconds.clone(),
        );
        registry.register("jobs", "Jobs by status", jobs.clone());
        registry.register("posts_waiting", "Results that wait to be written", waiting.clone());
        registry.register("alerts_open", "Alerts that are open", open_alerts.clone());
        let started = std::time::SystemTime::now()
            .duration_since(std::time::UNIX_EPOCH)
            .unwrap_or_default();
        Self {
            registry,
            requests,
            seconds,
            jobs,
            waiting,
            open_alerts,
            next_id: AtomicU64::new(0),
            started: started.as_secs(),
        }
    }
}

/// Gives a request its number, counts and logs it.
pub async fn observe(State(service): State<Arc<Service>>, request: Request<Body>, next: Next) -> Response {
    let counters = &service.counters;
    let given = request.headers().get(&REQUEST_ID).and_then(|id| id.to_str().ok());
    let given = given.filter(|id| (1..=100).contains(&id.len()) && id.bytes().all(|byte| byte.is_ascii_graphic()));
    let id = match given {
        Some(id) => id.to_owned(),
        None => format!("{:x}-{:x}", counters.started, counters.next_id.fetch_add(1, Relaxed)),
    };
    let method = request.method().to_string();
    let route = request.extensions().get::<MatchedPath>();
    let route = route.map_or("unknown", MatchedPath::as_str).to_owned();
    let path = request.uri().path().to_owned();
    let span = tracing::info_span!("request", id, method, path);
    let start = Instant::now();
    let mut response = next.run(request).instrument(span.clone()).await;
    let elapsed = start.elapsed();
    let status = response.status();
    let served = Served {
        method: method.clone(),
        route: route.clone(),
        status: status.as_u16(),
    };
    counters.requests.get_or_create(&served).inc();
    counters
        .seconds
        .get_or_create(&Timed { method, route })
        .observe(elapsed.as_secs_f64());
    let ms = elapsed.as_secs_f64() * 1e3;
    span.in_scope(|| match status.is_client_error() || status.is_server_error() {
        true => tracing::info!(status = status.as_u16(), ms, "refused"),
        false => tracing::debug!(status = status.as_u16(), ms, "answered"),
    });
    if let Ok(value) = HeaderValue::from_str(&id) {
        response.headers_mut().insert(REQUEST_ID, value);
    }
    response
}

/// `GET /metrics`, for Prometheus.
pub async fn metrics(State(service): Shared) -> Result<Response, ApiError> {
    let counters = &service.counters;
    for (status, n) in service.store.job_counts().await? {
        let status = serde_json::to_value(status).map_err(ApiError::internal)?;
        let status = status.as_str().unwrap_or_default().to_owned();
        counters.jobs.get_or_create(&ByStatus { status }).set(n);
    }
    counters.waiting.set(service.store.ingest().n_waiting() as i64);
    counters.open_alerts.set(service.store.n_open_alerts().await?);
    let mut text = String::new();
    encode(&mut text, &counters.registry).map_err(ApiError::internal)?;
    let media_type = "application/openmetrics-text; version=1.0.0; charset=utf-8";
    Ok(([(header::CONTENT_TYPE, media_type)], text).into_response())
}

/// `GET /healthz`: the process answers.
pub async fn alive() -> Json<serde_json::Value> {
    Json(json!({"status": "ok"}))
}

/// `GET /readyz`: it can do its work: the database answers, the worker runs, and nobody asked it to stop.
pub async fn ready(State(service): Shared) -> Result<Json<serde_json::Value>, ApiError> {
    let unready = |detail: &str| Err(ApiError::new(StatusCode::SERVICE_UNAVAILABLE, "not_ready", detail));
    if service.shutdown.is_cancelled() {
        return unready("the service is stopping");
    }
    if !service.worker_runs.load(Relaxed) {
        return unready("the worker has ended; see the log");
    }
    if service.store.ping().await.is_err() {
        return unready("the database does not answer");
    }
    let adapter = service
        .adapter
        .as_ref()
        .map(|adapter| adapter.name.clone())
        .map_err(Clone::clone);
    Ok(Json(
        json!({"status": "ok", "adapter": adapter.ok(), "adapter_problem": service.adapter.as_ref().err()}),
    ))
}
