//! The thread that owns the GPU: claim a job, run it, store its reports, again.
//!
//! A job keeps this thread busy for minutes. What must happen meanwhile is a task on the async runtime, the heartbeat:
//! four times a second it renews the job's lease, stores and announces its progress, and asks whether someone wants
//! its end; the run looks at that answer between frames.

use crate::{
    bench::{self, BenchReport, BenchSpec},
    gpu::{Gpu, GpuError},
    image::{
        Image,
        files::{
            FileReader,
            exr::{FloatFormat, write_map_exr, write_rgb_exr},
        },
    },
    run::{self, Comparison, Observer, RunError, RunSpec, Trace, report::AdapterInfo, report::Report},
    sequence::{Sequence, frame::Rgb},
    store::{
        Claim, DataFolder, Environment, Failure, FailureKind, Images, Outputs, Status, Store, StoreError, Timestamp,
    },
    stress::{
        self, Pictures, StressSpec,
        report::{Cell, StressReport},
    },
};
use std::{
    any::Any,
    fs, io,
    panic::{AssertUnwindSafe, catch_unwind, resume_unwind},
    path::Path,
    sync::{
        Arc,
        atomic::{AtomicBool, AtomicUsize, Ordering::Relaxed},
    },
    thread,
    time::Duration,
};
use tokio::{
    runtime::Handle,
    sync::{Notify, broadcast},
    time::{interval, sleep, timeout},
};
use tokio_util::sync::CancellationToken;

/// Long enough for a heartbeat delayed by a machine under load, short enough to wait for after a crash elsewhere.
const LEASE: Duration = Duration::from_secs(30);
const HEARTBEAT: Duration = Duration::from_millis(250);
/// How long the queue is left alone without being told of a new job.
const IDLE: Duration = Duration::from_secs(10);
/// What a driver gets to recover before its job is tried again.
const RETRY_DELAY: Duration = Duration::from_secs(1);

/// A job moved on; whoever wants to know more asks the store.
#[derive(Clone, Copy, Debug)]
pub struct JobEvent {
    /// Which job.
    pub job_id: i64,
    /// Where it stands now.
    pub status: Status,
    /// Frame × preset pairs with metrics.
    pub n_done: usize,
    /// Frame × preset pairs in all.
    pub n_total: usize,
}

/// Runs one job's presets over the sequence in a folder. The service's is [`GpuRunner`].
pub trait Runner: Send {
    /// As [`run::execute`].
    fn run(&mut self, sequence: &Path, spec: &RunSpec, observer: &dyn Observer) -> Result<Report, RunError>;

    /// As [`stress::execute`].
    fn stress(&mut self, spec: &StressSpec, observer: &dyn stress::Observer) -> Result<StressReport, RunError> {
        let _ = (spec, observer);
        Err(RunError::Internal("this worker puts no recipe under stress".to_owned()))
    }

    /// As [`bench::execute`].
    fn bench(&mut self, sequence: &Path, spec: &BenchSpec, observer: &dyn Observer) -> Result<BenchReport, RunError> {
        let _ = (sequence, spec, observer);
        Err(RunError::Internal("this worker measures nothing".to_owned()))
    }
}

/// Runs jobs on a GPU, which it opens anew after a failure.
pub struct GpuRunner {
    wanted: Option<String>,
    reader: FileReader,
    /// Most jobs of a service are of the same few presets, so it keeps their passes.
    gpu: Option<Gpu>,
}

impl GpuRunner {
    /// Opens the adapter: by its number or a part of its name, else the first one. Without one the runner is there all
    /// the same, and fails each job with the reason: a service without a driver can still show its history.
    pub fn new(wanted: Option<String>, reader: FileReader) -> (Self, Result<AdapterInfo, GpuError>) {
        // A CPU adapter starts its threads here.
        let give_way_and_open = || {
            give_way();
            open(wanted.as_deref())
        };
        let opened = thread::scope(|scope| scope.spawn(give_way_and_open).join());
        let opened = opened.unwrap_or_else(|panic| resume_unwind(panic));
        let gpu = opened.as_ref().ok().cloned();
        (Self { wanted, reader, gpu }, opened.map(|gpu| gpu.info()))
    }
}

impl Runner for GpuRunner {
    fn run(&mut self, sequence: &Path, spec: &RunSpec, observer: &dyn Observer) -> Result<Report, RunError> {
        let sequence = Sequence::open(sequence, &self.reader)?;
        self.on_gpu(|gpu| run::execute(spec, &sequence, gpu, observer))
    }

    fn stress(&mut self, spec: &StressSpec, observer: &dyn stress::Observer) -> Result<StressReport, RunError> {
        self.on_gpu(|gpu| stress::execute(spec, gpu, observer))
    }

    fn bench(&mut self, sequence: &Path, spec: &BenchSpec, observer: &dyn Observer) -> Result<BenchReport, RunError> {
        let sequence = Sequence::open(sequence, &self.reader)?;
        self.on_gpu(|gpu| Ok(bench::execute(spec, &sequence, gpu, observer)?))
    }
}

impl GpuRunner {
    fn on_gpu<T>(&mut self, work: impl FnOnce(&Gpu) -> Result<T, RunError>) -> Result<T, RunError> {
        // Taken, not borrowed: a device that failed, or that a panic left half-way through a frame, is not used again.
        let gpu = match self.gpu.take() {
            Some(gpu) => gpu,
            None => open(self.wanted.as_deref()).map_err(|error| RunError::Device(error.to_string()))?,
        };
        let result = work(&gpu);
        if !matches!(result, Err(RunError::Device(_))) {
            self.gpu = Some(gpu);
        }
        result
    }
}

fn open(wanted: Option<&str>) -> Result<Gpu, GpuError> {
    Ok(Gpu::open(wanted)?.caching())
}

/// Lets the threads that answer requests go before this one and all that it will start. On a CPU adapter a job keeps every core
/// busy for minutes, and a request waits for a core several times.
pub fn give_way() {
    const STEPS: i32 = 5;
    if let Err(error) = rustix::process::nice(STEPS) {
        tracing::warn!(%error, "jobs cannot give way to requests, which a job may slow");
    }
}

/// What a job made.
enum Outcome {
    Reports(Report),
    Matrix(StressReport),
    Front(BenchReport),
}

/// What the worker thread needs.
pub struct Worker {
    /// The queue.
    pub store: Store,
    /// Sequences and images.
    pub folder: DataFolder,
    /// Who wants to know of progress.
    pub events: broadcast::Sender<JobEvent>,
    /// Told of new jobs.
    pub wake: Arc<Notify>,
    /// Told to stop after the current frame.
    pub shutdown: CancellationToken,
    /// Runs the store's queries and the heartbeat.
    pub runtime: Handle,
    /// Reads images that came from elsewhere.
    pub reader: FileReader,
    /// How this machine's clocks are held; empty where they are not.
    pub clocks: String,
}

impl Worker {
    /// Works until told to stop.
    pub fn spawn(self, mut runner: impl Runner + 'static) -> io::Result<thread::JoinHandle<()>> {
        thread::Builder::new().name("worker".to_owned()).spawn(move || {
            give_way();
            while !self.shutdown.is_cancelled() {
                self.step(&mut runner);
            }
        })
    }

    /// Does the next job, or waits until there may be one.
    fn step(&self, runner: &mut dyn Runner) {
        match self.runtime.block_on(self.store.claim(LEASE, Timestamp::now())) {
            Ok(Some(claim)) => {
                tracing::info!(job = claim.job_id, attempt = claim.attempt, "job started");
                match self.job(&claim, runner) {
                    Ok(status) => tracing::info!(job = claim.job_id, ?status, "job ended"),
                    Err(error) => tracing::error!(job = claim.job_id, %error, "job's end could not be stored"),
                }
            }
            Ok(None) => self.pause(IDLE),
            Err(error) => {
                tracing::error!(%error, "cannot claim a job");
                self.pause(RETRY_DELAY);
            }
        }
    }

    /// Waits, unless there is something to do.
    fn pause(&self, duration: Duration) {
        self.runtime.block_on(async {
            tokio::select! {
                () = self.shutdown.cancelled() => {}
                _ = timeout(duration, self.wake.notified()) => {}
            }
        });
    }

    /// Runs a claimed job to whatever end it finds, and stores that end.
    fn job(&self, claim: &Claim, runner: &mut dyn Runner) -> Result<Status, StoreError> {
        let progress = Arc::new(Progress::default());
        let heartbeat = self.runtime.spawn(heartbeat(
            self.store.clone(),
            claim.clone(),
            Arc::clone(&progress),
            self.events.clone(),
        ));
        self.store.ingest().gather(true);
        let outcome = self.run(claim, runner, &progress);
        self.store.ingest().gather(false);
        heartbeat.abort();
        // Even an aborted heartbeat may be in the middle of a query; nothing may follow the job's end.
        let _ = self.runtime.block_on(heartbeat);

        let ended = self.runtime.block_on(self.end(claim, outcome, &progress));
        if !matches!(ended, Ok(Status::Done)) {
            self.discard_outputs(claim.job_id);
        }
        if let Ok(status) = ended {
            let _ = self.events.send(progress.event(claim.job_id, status));
        }
        if matches!(ended, Ok(Status::Queued)) && !self.shutdown.is_cancelled() {
            self.runtime.block_on(async {
                tokio::select! { () = self.shutdown.cancelled() => {}, () = sleep(RETRY_DELAY) => {} }
            });
        }
        ended
    }

    /// The run itself; a panic in it is the job's failure, not the service's.
    fn run(&self, claim: &Claim, runner: &mut dyn Runner, progress: &Progress) -> Result<Outcome, RunError> {
        self.discard_outputs(claim.job_id);
        let observer = JobObserver {
            worker: self,
            claim,
            progress,
        };
        let folder = self.folder.sequence(&claim.sequence_hash);
        let spec = &claim.spec;
        let run = AssertUnwindSafe(|| {
            if let Some(stress) = &spec.stress {
                return runner.stress(stress, &observer).map(Outcome::Matrix);
            }
            if let Some(bench) = &spec.bench {
                return runner.bench(&folder, bench, &observer).map(Outcome::Front);
            }
            let reports = match &spec.outputs {
                Some(outputs) => self.compare(&folder, &spec.run, outputs, &observer),
                None => runner.run(&folder, &spec.run, &observer),
            };
            reports.map(Outcome::Reports)
        });
        catch_unwind(run).unwrap_or_else(|panic| Err(RunError::Internal(panic_message(&*panic).to_owned())))
    }

    /// Images of another system against the sequence's references.
    fn compare(
        &self,
        folder: &Path,
        spec: &RunSpec,
        outputs: &Outputs,
        observer: &dyn Observer,
    ) -> Result<Report, RunError> {
        let sequence = Sequence::open(folder, &self.reader)?;
        let comparison = Comparison {
            system: outputs.system.clone(),
            parameters: serde_json::Value::Object(outputs.parameters.clone()),
            adapter: outputs.environment.adapter.clone(),
            images: outputs.images.values().map(|hash| self.folder.blob(hash)).collect(),
            metrics: spec.metrics.clone(),
        };
        run::compare_outputs(&comparison, &sequence, observer)
    }

    async fn end(
        &self,
        claim: &Claim,
        outcome: Result<Outcome, RunError>,
        progress: &Progress,
    ) -> Result<Status, StoreError> {
        let now = Timestamp::now();
        let (kind, code) = match &outcome {
            Ok(Outcome::Reports(report)) => {
                self.store.finish(claim, report, &self.environment(report), now).await?;
                return Ok(Status::Done);
            }
            Ok(Outcome::Matrix(report)) => {
                self.store.finish_stress(claim, report, now).await?;
                return Ok(Status::Done);
            }
            Ok(Outcome::Front(report)) => {
                self.store.finish_bench(claim, report, now).await?;
                return Ok(Status::Done);
            }
            Err(RunError::Cancelled) if progress.cancelled.load(Relaxed) => {
                self.store.finish_cancelled(claim, now).await?;
                return Ok(Status::Cancelled);
            }
            Err(RunError::Cancelled) => {
                self.store.hand_back(claim).await?;
                return Ok(Status::Queued);
            }
            Err(RunError::Input(_)) => (FailureKind::Input, "invalid_input"),
            Err(RunError::Device(_)) => (FailureKind::Device, "gpu_failed"),
            Err(RunError::Internal(_)) => (FailureKind::Internal, "internal"),
        };
        let message = outcome.err().map(|error| error.to_string()).unwrap_or_default();
        // Where the service keeps a sequence is nobody's business.
        let folder = format!("{}/", self.folder.sequence(&claim.sequence_hash).display());
        let message = message.replace(&folder, "");
        tracing::warn!(job = claim.job_id, attempt = claim.attempt, ?kind, %message, "job failed");
        let failure = Failure {
            kind,
            code: code.to_owned(),
            message,
        };
        self.store.fail(claim, &failure, now).await
    }

    /// What ran: the adapter as the run found it, on this machine.
    fn environment(&self, report: &Report) -> Environment {
        Environment {
            adapter: report.adapter.clone(),
            os: operating_system(),
            clocks: self.clocks.clone(),
        }
    }

    /// Removes the images of a job that has no report to go with them.
    fn discard_outputs(&self, job_id: i64) {
        if let Err(error) = self.folder.remove_outputs(job_id) {
            tracing::warn!(job = job_id, %error, "cannot remove the job's images");
        }
    }
}

/// This machine's system and its version, such as `debian 12`.
pub fn operating_system() -> String {
    let text = fs::read_to_string("/etc/os-release").unwrap_or_default();
    let field = |name: &str| {
        let line = text.lines().find_map(|line| line.strip_prefix(name)?.strip_prefix('='));
        line.unwrap_or_default().trim_matches('"').to_owned()
    };
    let known = format!("{} {}", field("ID"), field("VERSION_ID"));
    match known.trim() {
        "" => std::env::consts::OS.to_owned(),
        known => known.to_owned(),
    }
}

/// What the run's threads and the heartbeat tell each other.
#[derive(Default)]
struct Progress {
    n_done: AtomicUsize,
    n_total: AtomicUsize,
    cancelled: AtomicBool,
}

impl Progress {
    fn event(&self, job_id: i64, status: Status) -> JobEvent {
        JobEvent {
            job_id,
            status,
            n_done: self.n_done.load(Relaxed),
            n_total: self.n_total.load(Relaxed),
        }
    }
}

/// Renews the claim until it is lost or the task aborted.
async fn heartbeat(store: Store, claim: Claim, progress: Arc<Progress>, events: broadcast::Sender<JobEvent>) {
    let mut ticks = interval(HEARTBEAT);
    loop {
        ticks.tick().await;
        let event = progress.event(claim.job_id, Status::Running);
        let lease_until = Timestamp::now() + LEASE;
        match store.heartbeat(&claim, event.n_done, event.n_total, lease_until).await {
            Ok(cancel) => progress.cancelled.store(cancel, Relaxed),
            Err(error @ StoreError::ClaimLost(_)) => {
                tracing::error!(job = claim.job_id, %error);
                progress.cancelled.store(true, Relaxed);
                return;
            }
            // Another beat comes before the lease runs out.
            Err(error) => tracing::warn!(job = claim.job_id, %error, "cannot renew the lease"),
        }
        let _ = events.send(event);
    }
}

struct JobObserver<'a> {
    worker: &'a Worker,
    claim: &'a Claim,
    progress: &'a Progress,
}

impl JobObserver<'_> {
    /// Of the images, and of how they came about; a job that keeps none writes neither.
    fn format(&self) -> FloatFormat {
        match self.claim.spec.images {
            Images::None | Images::Half => FloatFormat::Half,
            Images::Float => FloatFormat::Float,
        }
    }
}

impl Observer for JobObserver<'_> {
    fn progress(&self, n_done: usize, n_total: usize) {
        self.progress.n_done.store(n_done, Relaxed);
        self.progress.n_total.store(n_total, Relaxed);
    }

    fn wants_output(&self) -> bool {
        self.claim.spec.images != Images::None
    }

    fn output(&self, preset_index: usize, frame_index: usize, image: &Image<Rgb>) -> Result<(), io::Error> {
        let path = self.worker.folder.output(self.claim.job_id, preset_index, frame_index);
        if let Some(folder) = path.parent() {
            fs::create_dir_all(folder)?;
        }
        write_rgb_exr(&path, image, self.format()).map_err(io::Error::other)
    }

    fn trace(
        &self,
        preset_index: usize,
        frame_index: usize,
        trace: Trace,
        image: &Image<f32>,
    ) -> Result<(), io::Error> {
        let folder = &self.worker.folder;
        let path = folder.trace(self.claim.job_id, preset_index, frame_index, trace);
        write_map_exr(&path, image, self.format()).map_err(io::Error::other)
    }

    fn cancelled(&self) -> bool {
        self.progress.cancelled.load(Relaxed) || self.worker.shutdown.is_cancelled()
    }
}

impl stress::Observer for JobObserver<'_> {
    fn cell(&self, index: usize, _cell: &Cell, pictures: Option<&Pictures>, n_done: usize, n_total: usize) {
        Observer::progress(self, n_done, n_total);
        let Some(pictures) = pictures else { return };
        let path = self.worker.folder.stress_picture(self.claim.job_id, index);
        let written = path.parent().map_or(Ok(()), fs::create_dir_all);
        if let Err(error) = written.and_then(|()| fs::write(&path, pictures.png())) {
            tracing::warn!(job = self.claim.job_id, %error, "cannot keep the picture of a cell");
        }
    }

    fn cancelled(&self) -> bool {
        Observer::cancelled(self)
    }
}

/// What a panic said.
fn panic_message(panic: &(dyn Any + Send)) -> &str {
    let text = panic.downcast_ref::<String>().map(String::as_str);
    text.or_else(|| panic.downcast_ref::<&str>().copied())
        .unwrap_or("the run panicked")
}
