//! The service: routes under `/api/v1`, one file a resource, and the pages of `web`. With `web` the only module that
//! names axum. Handlers parse, ask the store, answer; what takes long is the worker's.

mod access;
mod admin;
mod alerts;
mod answers;
mod api;
pub(crate) mod bench;
mod blobs;
mod catalog;
mod conditional;
mod encoding;
mod error;
mod events;
mod export;
mod extract;
mod frames;
mod idempotency;
mod jobs;
mod judging;
mod marks;
mod observe;
mod origin;
mod page;
mod reports;
mod results;
mod routes;
mod sequences;
pub(crate) mod stress;
mod tidying;
mod unread;
mod upload;
mod webhooks;

pub use access::Caller;
pub use error::ApiError;
pub use extract::{ApiPath, ApiQuery};
pub use frames::{DEFAULT_MAX_ERROR, trace_file};

use self::{
    access::Access,
    answers::Answers,
    api::{Api, BASE, Scopes},
    blobs::BlobWriters,
    idempotency::InProgress,
    observe::Counters,
};
use crate::{
    checker::Checker,
    config::{Config, ConfigError},
    image::files::{Backend, FileReader, Limits},
    run::report::AdapterInfo,
    store::{DataFolder, FolderError, Store, StoreError, Timestamp},
    web,
    worker::{GpuRunner, JobEvent, Runner, Worker, give_way},
};
use axum::{
    Router,
    extract::{DefaultBodyLimit, OriginalUri},
    http::{HeaderValue, Request, StatusCode, header},
    middleware::{self, Next},
    response::Response,
    routing::{any, get},
};
use serde_json::Value;
use std::{
    io,
    net::SocketAddr,
    sync::{
        Arc, LazyLock,
        atomic::{AtomicBool, Ordering::Relaxed},
    },
    thread::JoinHandle,
    time::Duration,
};
use tokio::{
    net::TcpListener,
    runtime::Handle,
    signal::unix::{SignalKind, signal},
    sync::{Notify, broadcast},
    time::sleep,
};
use tokio_util::{sync::CancellationToken, task::TaskTracker};
use tower_http::{
    compression::{
        CompressionLayer,
        predicate::{NotForContentType, Predicate, SizeAbove},
    },
    decompression::RequestDecompressionLayer,
    timeout::RequestBodyTimeoutLayer,
};

/// Why the service could not start, or ended.
#[derive(Debug, thiserror::Error)]
pub enum ServeError {
    /// A setting is wrong.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// The data folder cannot be used.
    #[error(transparent)]
    Folder(#[from] FolderError),
    /// The database cannot be used.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// The address is taken, or not ours.
    #[error("cannot listen on {address}: {source}; choose another with --listen")]
    Listen {
        /// What was asked for.
        address: SocketAddr,
        /// What the system said.
        source: io::Error,
    },
    /// The system refused a thread or a signal handler.
    #[error("cannot run: {0}")]
    System(#[from] io::Error),
}

/// What every handler shares.
pub struct Service {
    /// Sequences, jobs, reports.
    pub store: Store,
    /// Their files.
    pub folder: DataFolder,
    /// Reads the sequences' images.
    pub reader: FileReader,
    /// Limits of what is accepted.
    pub config: Config,
    /// The adapter found at start, or why there was none.
    pub adapter: Result<AdapterInfo, String>,
    /// Progress of running jobs.
    pub events: broadcast::Sender<JobEvent>,
    /// Tells the worker of new jobs.
    pub wake: Arc<Notify>,
    /// Tells the checker of new sequences.
    pub wake_checker: Arc<Notify>,
    /// Tells everyone that the service is ending.
    pub shutdown: CancellationToken,
    /// Requests that may write, whose clients may have left.
    writes: TaskTracker,
    /// Tells the postman of new deliveries.
    pub deliver: Notify,
    /// Whether the worker's thread is there.
    pub worker_runs: AtomicBool,
    /// Tokens in use.
    access: Access,
    /// Requests with an idempotency key.
    in_progress: InProgress,
    /// Answers of the store as it is.
    answers: Answers,
    /// Uploads of blobs.
    blob_writers: BlobWriters,
    /// Verdicts on branches.
    turns: judging::Turns,
    /// What Prometheus is told.
    counters: Counters,
}

/// The OpenAPI document.
pub fn document() -> &'static Value {
    static DOCUMENT: LazyLock<Value> = LazyLock::new(|| api().2);
    &DOCUMENT
}

/// How long open requests may take to end once the service stops: a client that sends nothing more would keep it for ever.
const GRACE: Duration = Duration::from_secs(8);

/// How long a client may send nothing in the midst of a request, or between two: one that is gone would keep its place, and
/// the upload that it has begun, for ever.
const PATIENCE: Duration = Duration::from_secs(20);

/// How handlers take [`Service`].
pub type Shared = axum::extract::State<Arc<Service>>;

/// A service that listens; [`Running::run`] serves until it is told to stop.
pub struct Running {
    /// Where it listens; the port is the real one even if 0 was asked for.
    pub address: SocketAddr,
    service: Arc<Service>,
    listener: TcpListener,
    worker: JoinHandle<()>,
    checker: JoinHandle<()>,
}

/// Serves until SIGINT or SIGTERM, then hands the running job back to the queue and returns.
pub async fn serve(config: Config) -> Result<(), ServeError> {
    // Whoever of them starts it, the pool is for jobs and for pictures, neither of which is to keep a request waiting.
    let pool = rayon::ThreadPoolBuilder::new().start_handler(|_| give_way());
    if let Err(error) = pool.build_global() {
        tracing::warn!(%error, "the pool of threads was there before");
    }
    let reader = FileReader::new(Backend::Auto, Limits::default());
    let (runner, found) = GpuRunner::new(config.adapter.clone(), reader.clone());
    match &found {
        Ok(adapter) => tracing::info!(name = adapter.name, driver = adapter.driver, "adapter"),
        Err(error) => tracing::error!(%error, "no adapter: jobs will fail until there is one"),
    }
    let running = Running::start(config, reader, runner, found.map_err(|error| error.to_string())).await?;
    let shutdown = running.service.shutdown.clone();
    let (mut interrupt, mut terminate) = (signal(SignalKind::interrupt())?, signal(SignalKind::terminate())?);
    tokio::spawn(async move {
        tokio::select! { _ = interrupt.recv() => {}, _ = terminate.recv() => {} }
        tracing::info!("stopping after the current frame");
        shutdown.cancel();
    });
    tracing::info!("listening on http://{}", running.address);
    running.run().await
}

impl Running {
    /// Opens everything, takes up what a crash left, and starts the worker with `runner`.
    pub async fn start(
        config: Config,
        reader: FileReader,
        runner: impl Runner + 'static,
        adapter: Result<AdapterInfo, String>,
    ) -> Result<Self, ServeError> {
        config.validate()?;
        let folder = DataFolder::open(&config.data)?;
        let store = Store::open(&folder.database()).await?;
        // The folder's lock is ours, so no other worker can be alive whatever the leases say.
        for job in store.recover(Timestamp::MAX, Timestamp::now()).await? {
            tracing::warn!(job, "taking up a job that was left running");
            folder.remove_outputs(job)?;
        }
        let address = config.listen;
        let now = Timestamp::now();
        if config.asks_for_tokens()
            && !address.ip().is_loopback()
            && !store.tokens().await?.iter().any(|token| token.is_live(now))
        {
            return Err(ConfigError::Exposed(address).into());
        }
        let listener = TcpListener::bind(address)
            .await
            .map_err(|source| ServeError::Listen { address, source })?;
        let service = Arc::new(Service {
            store,
            folder,
            reader,
            config,
            adapter,
            events: broadcast::channel(256).0,
            wake: Arc::new(Notify::new()),
            wake_checker: Arc::new(Notify::new()),
            shutdown: CancellationToken::new(),
            writes: TaskTracker::new(),
            deliver: Notify::new(),
            worker_runs: AtomicBool::new(true),
            access: Access::new(api().1),
            in_progress: InProgress::default(),
            answers: Answers::default(),
            blob_writers: BlobWriters::default(),
            turns: judging::Turns::default(),
            counters: Counters::new(),
        });
        let worker = Worker {
            store: service.store.clone(),
            folder: service.folder.clone(),
            events: service.events.clone(),
            wake: Arc::clone(&service.wake),
            shutdown: service.shutdown.clone(),
            runtime: Handle::current(),
            reader: service.reader.clone(),
            clocks: service.config.clocks.clone(),
        };
        let checker = Checker {
            store: service.store.clone(),
            folder: service.folder.clone(),
            reader: service.reader.clone(),
            wake: Arc::clone(&service.wake_checker),
            shutdown: service.shutdown.clone(),
            runtime: Handle::current(),
        };
        Ok(Self {
            address: listener.local_addr()?,
            service,
            listener,
            worker: worker.spawn(runner)?,
            checker: checker.spawn()?,
        })
    }

    /// Ends [`Running::run`] from elsewhere.
    pub fn stop_token(&self) -> CancellationToken {
        self.service.shutdown.clone()
    }

    /// Answers requests until stopped; then lets open requests end, for a while, and the current frame.
    pub async fn run(self) -> Result<(), ServeError> {
        let shutdown = self.service.shutdown.clone();
        let connections = axum_server::Handle::new();
        let late = async {
            shutdown.cancelled().await;
            connections.graceful_shutdown(None);
            sleep(GRACE).await;
        };
        let postman = tokio::spawn(webhooks::deliver(Arc::clone(&self.service)));
        let tidying = tokio::spawn(tidying::tidy(Arc::clone(&self.service)));
        let serving = async {
            let mut server = axum_server::Server::<SocketAddr>::from_listener(self.listener)
                .http1_only()
                .accept_error_handler(|_, error| tracing::error!(%error, "cannot accept a connection"))
                .handle(connections.clone());
            server.http_builder().http1().header_read_timeout(PATIENCE);
            let served = server
                .serve(router(Arc::clone(&self.service)).into_make_service())
                .await;
            self.service.writes.close();
            self.service.writes.wait().await;
            served
        };
        let served = tokio::select! {
            served = serving => served,
            () = late => {
                tracing::warn!("requests are cut off that were still open {GRACE:?} after the stop");
                connections.shutdown();
                Ok(())
            }
        };
        shutdown.cancel();
        for task in [postman, tidying] {
            let _ = task.await;
        }
        for (name, thread) in [("worker", self.worker), ("checker", self.checker)] {
            if !matches!(tokio::task::spawn_blocking(move || thread.join()).await, Ok(Ok(()))) {
                tracing::error!("the {name}'s thread did not end properly");
            }
        }
        self.service.worker_runs.store(false, Relaxed);
        self.service.store.close().await;
        Ok(served?)
    }
}

/// Runs what takes long where it may block; its lines of the log are the request's.
async fn blocking<T: Send + 'static>(work: impl FnOnce() -> T + Send + 'static) -> Result<T, ApiError> {
    let span = tracing::Span::current();
    tokio::task::spawn_blocking(move || span.in_scope(work))
        .await
        .map_err(ApiError::internal)
}

/// Every route, which scope each needs, and the OpenAPI document.
fn api() -> (Router<Arc<Service>>, Scopes, Value) {
    let api = routes::results(routes::sequences(routes::catalog(Api::new())));
    let api = routes::admin(routes::verdicts(routes::studies(api)));
    api.finish()
}

/// The whole service.
pub fn router(service: Arc<Service>) -> Router {
    let (api, ..) = self::api();
    let max_json_bytes = service.config.max_json_kib * 1024;
    let with_service = Arc::clone(&service);
    let with = || Arc::clone(&with_service);
    // The last layer is the outermost.
    let api = api
        .fallback(unknown_path)
        .layer(middleware::from_fn_with_state(with(), idempotency::once))
        .layer(middleware::from_fn_with_state(service.writes.clone(), answers::finish))
        .layer(middleware::from_fn_with_state(with(), conditional::tag));
    Router::new()
        .nest(BASE, api)
        .route(&format!("{BASE}/"), any(unknown_path))
        .route("/metrics", get(observe::metrics))
        .route("/healthz", get(observe::alive))
        .route("/readyz", get(observe::ready))
        .merge(web::routes())
        .method_not_allowed_fallback(wrong_method)
        .layer(DefaultBodyLimit::max(max_json_bytes))
        .layer(RequestDecompressionLayer::new())
        .layer(middleware::from_fn(known_encoding))
        .layer(RequestBodyTimeoutLayer::new(PATIENCE))
        .layer(middleware::from_fn_with_state(with(), access::control))
        .layer(middleware::from_fn(unread::finish))
        .layer(CompressionLayer::new().compress_when(worth_compressing()))
        .layer(middleware::from_fn(security_headers))
        .layer(middleware::from_fn_with_state(with(), observe::observe))
        .with_state(service)
}

/// Text of some length; not events, which must not wait, nor images, which are compressed.
fn worth_compressing() -> impl Predicate {
    SizeAbove::new(1024)
        .and(NotForContentType::GRPC)
        .and(NotForContentType::IMAGES)
        .and(NotForContentType::SSE)
        .and(NotForContentType::const_new("application/x-tar"))
        .and(NotForContentType::const_new("application/vnd.apache.parquet"))
}

/// Bytes that cannot be unfolded would be taken for what they are not.
async fn known_encoding(mut request: Request<axum::body::Body>, next: Next) -> Result<Response, ApiError> {
    let encoding = request.headers().get(header::CONTENT_ENCODING);
    let encoding = encoding.map_or(Vec::new(), |encoding| encoding.as_bytes().to_ascii_lowercase());
    match encoding.as_slice() {
        b"" | b"identity" => return Ok(next.run(request).await),
        b"gzip" | b"x-gzip" => {
            let gzip = HeaderValue::from_static("gzip");
            request.headers_mut().insert(header::CONTENT_ENCODING, gzip);
            return Ok(next.run(request).await);
        }
        _ => {}
    }
    let detail = "the body may be sent as it is or with `content-encoding: gzip`";
    let refused = ApiError::new(StatusCode::UNSUPPORTED_MEDIA_TYPE, "unknown_encoding", detail);
    Err(refused.field("content-encoding"))
}

async fn unknown_path(OriginalUri(uri): OriginalUri) -> ApiError {
    ApiError::not_found(format!("there is nothing at {}", uri.path()))
}

async fn wrong_method(request: Request<axum::body::Body>) -> ApiError {
    ApiError::new(
        StatusCode::METHOD_NOT_ALLOWED,
        "method_not_allowed",
        format!(
            "{} cannot be used here; the header `allow` lists what can",
            request.method()
        ),
    )
}

/// Everything a page needs is embedded, so nothing may come from elsewhere.
const CONTENT_SECURITY_POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; \
     connect-src 'self'; form-action 'self'; base-uri 'none'; frame-ancestors 'none'";

async fn security_headers(request: Request<axum::body::Body>, next: Next) -> Response {
    let mut response = next.run(request).await;
    let headers = response.headers_mut();
    for (name, value) in [
        (header::CONTENT_SECURITY_POLICY, CONTENT_SECURITY_POLICY),
        (header::X_CONTENT_TYPE_OPTIONS, "nosniff"),
        (header::REFERRER_POLICY, "no-referrer"),
    ] {
        headers.insert(name, HeaderValue::from_static(value));
    }
    response
}
