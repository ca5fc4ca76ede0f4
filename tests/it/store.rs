//! The store: what survives a crash, what is visible when, and that no number is lost on the way.

use afterimage::{
    image::Extent,
    metrics::{Metric, Summary, Value},
    run::{
        MetricsOn, PresetSpec, RunSpec, Validate,
        report::{AdapterInfo, FrameReport, PresetReport, Report, SequenceInfo, TimeSummary},
    },
    store::{
        Cancelled, Claim, DEFAULT_PROJECT, Environment, Failure, FailureKind, GPU_TIME, Images, JobFilter, JobSpec,
        MAX_ATTEMPTS, NewJob, NewSequence, Provenance, ReportFilter, SeriesFilter, Status, Store, StoreError,
        Timestamp,
    },
    taa::{Precision, Skip},
};
use std::{collections::BTreeMap, path::Path, time::Duration};
use tempfile::TempDir;

const LEASE: Duration = Duration::from_secs(30);
const T0: Timestamp = Timestamp(1_700_000_000_000);

fn after(seconds: u64) -> Timestamp {
    T0 + Duration::from_secs(seconds)
}

/// A store in a folder of its own, with one sequence.
pub async fn store() -> (TempDir, Store, i64) {
    let folder = tempfile::tempdir().unwrap();
    let store = Store::open(&database(folder.path())).await.unwrap();
    let (sequence, new) = store.put_sequence(&sequence("aa", "ship"), T0).await.unwrap();
    assert!(new);
    (folder, store, sequence.id)
}

pub fn database(folder: &Path) -> std::path::PathBuf {
    folder.join("test.sqlite")
}

fn sequence(hash: &str, name: &str) -> NewSequence {
    NewSequence {
        hash: hash.to_owned(),
        name: name.to_owned(),
        manifest: r#"{"name":"ship"}"#.to_owned(),
        render_size: Extent::new(64, 48),
        output_size: Extent::new(64, 48),
        n_frames: 3,
        n_bytes: 1000,
    }
}

pub fn job(sequence_id: i64, presets: &[&str]) -> NewJob {
    let preset = |id: &&str| PresetSpec {
        preset: (*id).to_owned(),
        parameters: serde_json::Map::new(),
    };
    NewJob {
        sequence_id: Some(sequence_id),
        spec: JobSpec {
            run: RunSpec {
                presets: presets.iter().map(preset).collect(),
                metrics: vec![Metric::PSNR],
                history: Precision::F16,
                n_frames: None,
                repeat: 1,
                metrics_on: MetricsOn::Auto,
                validate: Validate::No,
                until: None,
                skip: Skip::Off,
            },
            images: Images::Half,
            outputs: None,
            stress: None,
            bench: None,
        },
        project: DEFAULT_PROJECT.to_owned(),
        provenance: Provenance {
            branch: Some("main".to_owned()),
            commit: Some("0123abcd".to_owned()),
            ..Provenance::default()
        },
        result_key: None,
    }
}

pub fn frame(index: usize, psnr: f64) -> FrameReport {
    FrameReport {
        index,
        reset: index == 0,
        warmup: index == 0,
        repaired_texels: index as u64,
        non_finite_pixels: 2,
        metrics: BTreeMap::from([("psnr".to_owned(), Value(psnr))]),
        times_ms: BTreeMap::from([("resolve".to_owned(), 0.5), ("decode".to_owned(), 9.0)]),
    }
}

/// A report with these PSNRs for each of `presets`.
fn report(presets: &[&str], psnr: &[f64]) -> Report {
    let time = |median| TimeSummary {
        median,
        min: median,
        mad: 0.0,
        n: 3,
    };
    let preset = |id: &&str| PresetReport {
        preset: (*id).to_owned(),
        parameters: serde_json::json!({"current_weight": 0.1}),
        notes: vec!["the input is jittered".to_owned()],
        validation: None,
        skipped: None,
        frames: psnr.iter().enumerate().map(|(i, &x)| frame(i, x)).collect(),
        summary: BTreeMap::from([(
            "psnr".to_owned(),
            Summary::new(Metric::PSNR, psnr.iter().map(|&x| Value(x))),
        )]),
        times_ms: BTreeMap::from([("prepare".to_owned(), time(0.25)), ("resolve".to_owned(), time(0.5))]),
    };
    Report {
        sequence: SequenceInfo {
            name: "ship".to_owned(),
            hash: "aa".to_owned(),
            render_size: Extent::new(64, 48),
            output_size: Extent::new(64, 48),
            n_frames: psnr.len(),
        },
        adapter: adapter("1.0"),
        revision: "abc".to_owned(),
        metric_versions: BTreeMap::from([("psnr".to_owned(), 1)]),
        stages_ms: BTreeMap::from([("total".to_owned(), 12.5)]),
        reports: presets.iter().map(preset).collect(),
    }
}

fn adapter(driver_version: &str) -> AdapterInfo {
    AdapterInfo {
        name: "llvmpipe".to_owned(),
        backend: "Vulkan".to_owned(),
        kind: "Cpu".to_owned(),
        driver: "Mesa".to_owned(),
        driver_version: driver_version.to_owned(),
    }
}

pub fn environment() -> Environment {
    in_environment(adapter("1.0"))
}

fn in_environment(adapter: AdapterInfo) -> Environment {
    Environment {
        adapter,
        os: "debian 12".to_owned(),
        clocks: String::new(),
    }
}

async fn claimed(store: &Store, sequence_id: i64, presets: &[&str]) -> Claim {
    store.enqueue(&job(sequence_id, presets), T0).await.unwrap();
    store.claim(LEASE, T0).await.unwrap().unwrap()
}

async fn status(store: &Store, id: i64) -> Status {
    store.job(id).await.unwrap().unwrap().status
}

#[tokio::test]
async fn a_crash_gives_the_job_back_and_a_bounded_number_of_times() {
    let (folder, store, sequence_id) = store().await;
    let id = store.enqueue(&job(sequence_id, &["ema"]), T0).await.unwrap();
    drop(store);
    for attempt in 1..=MAX_ATTEMPTS {
        // Each round is a process that dies with the job in its hands: nothing is closed, handed back or failed.
        let store = Store::open(&database(folder.path())).await.unwrap();
        let claim = store.claim(LEASE, T0).await.unwrap().unwrap();
        assert_eq!((claim.job_id, claim.attempt), (id, attempt));
        store.heartbeat(&claim, 2, 3, after(60)).await.unwrap();
        drop(store);
        let store = Store::open(&database(folder.path())).await.unwrap();
        assert_eq!(store.recover(Timestamp::MAX, T0).await.unwrap(), [id]);
        assert_eq!(store.job(id).await.unwrap().unwrap().n_done, 0);
    }
    let store = Store::open(&database(folder.path())).await.unwrap();
    let failed = store.job(id).await.unwrap().unwrap();
    assert_eq!(failed.status, Status::Failed);
    let error = failed.error.as_ref().unwrap();
    assert_eq!(
        (error.kind, error.code.as_str()),
        (FailureKind::Internal, "interrupted")
    );
    assert!(error.message.contains("3 times"), "{}", error.message);
    assert!(store.claim(LEASE, T0).await.unwrap().is_none());
}

#[tokio::test]
async fn a_lease_protects_a_job_until_it_runs_out() {
    let (_folder, store, sequence_id) = store().await;
    let first = claimed(&store, sequence_id, &["ema"]).await;
    assert!(store.claim(LEASE, after(1)).await.unwrap().is_none(), "claimed twice");
    assert!(
        store.recover(after(29), after(29)).await.unwrap().is_empty(),
        "the lease still holds"
    );
    store.heartbeat(&first, 1, 3, after(60)).await.unwrap();
    assert!(
        store.recover(after(59), after(59)).await.unwrap().is_empty(),
        "the lease was renewed"
    );
    assert_eq!(store.recover(after(61), after(61)).await.unwrap(), [first.job_id]);

    let second = store.claim(LEASE, after(62)).await.unwrap().unwrap();
    assert_eq!((second.job_id, second.attempt), (first.job_id, 2));
    let lost = |result: Result<(), StoreError>| assert!(matches!(result, Err(StoreError::ClaimLost(_))), "{result:?}");
    let results = report(&["ema"], &[30.0]);
    lost(store.finish(&first, &results, &environment(), T0).await.map(drop));
    lost(store.heartbeat(&first, 1, 3, after(90)).await.map(drop));
    lost(store.hand_back(&first).await);
    lost(store.finish_cancelled(&first, T0).await);
    assert_eq!(status(&store, first.job_id).await, Status::Running);
    assert_eq!(
        store.finish(&second, &results, &environment(), T0).await.unwrap().len(),
        1
    );
    lost(store.finish(&second, &results, &environment(), T0).await.map(drop));
}

#[tokio::test]
async fn a_job_handed_back_has_lost_no_attempt() {
    let (_folder, store, sequence_id) = store().await;
    let claim = claimed(&store, sequence_id, &["ema"]).await;
    store.hand_back(&claim).await.unwrap();
    let again = store.claim(LEASE, T0).await.unwrap().unwrap();
    assert_eq!((again.job_id, again.attempt), (claim.job_id, 1));
}

#[tokio::test]
async fn only_device_failures_are_tried_again() {
    let (_folder, store, sequence_id) = store().await;
    let failure = |kind| Failure {
        kind,
        code: "x".to_owned(),
        message: "y".to_owned(),
    };
    for kind in [FailureKind::Input, FailureKind::Internal] {
        let claim = claimed(&store, sequence_id, &["ema"]).await;
        assert_eq!(store.fail(&claim, &failure(kind), T0).await.unwrap(), Status::Failed);
        assert_eq!(
            store
                .job(claim.job_id)
                .await
                .unwrap()
                .unwrap()
                .error
                .as_ref()
                .unwrap()
                .kind,
            kind
        );
    }
    let mut claim = claimed(&store, sequence_id, &["ema"]).await;
    for _ in 1..MAX_ATTEMPTS {
        assert_eq!(
            store.fail(&claim, &failure(FailureKind::Device), T0).await.unwrap(),
            Status::Queued
        );
        claim = store.claim(LEASE, T0).await.unwrap().unwrap();
    }
    assert_eq!(
        store.fail(&claim, &failure(FailureKind::Device), T0).await.unwrap(),
        Status::Failed
    );
}

#[tokio::test]
async fn a_report_is_visible_whole_or_not_at_all() {
    let (folder, store, sequence_id) = store().await;
    let claim = claimed(&store, sequence_id, &["ema", "inside"]).await;
    // The second preset repeats a frame, which is refused after everything before it was written.
    let mut broken = report(&["ema", "inside"], &[30.0, 31.0]);
    broken.reports[1].frames.push(frame(0, 1.0));
    assert!(store.finish(&claim, &broken, &environment(), T0).await.is_err());
    assert_eq!(status(&store, claim.job_id).await, Status::Running);
    let all = ReportFilter {
        limit: 100,
        ..ReportFilter::default()
    };
    assert!(store.reports(&all).await.unwrap().is_empty());
    assert!(store.series(&SeriesFilter::default()).await.unwrap().is_empty());

    // Readers that ask all the time while it is written see nothing or everything.
    let reader = Store::open(&database(folder.path())).await.unwrap();
    let filter = all.clone();
    let watcher = tokio::spawn(async move {
        loop {
            let reports = reader.reports(&filter).await.unwrap();
            if reports.is_empty() {
                continue;
            }
            for report in &reports {
                assert_eq!(reader.frames(report.id).await.unwrap().len(), 200);
            }
            return reports.len();
        }
    });
    let whole = report(&["ema", "inside"], &vec![30.0; 200]);
    let ids = store.finish(&claim, &whole, &environment(), T0).await.unwrap();
    assert_eq!(watcher.await.unwrap(), 2);
    assert_eq!(ids.len(), 2);
    assert_eq!(status(&store, claim.job_id).await, Status::Done);
}

#[tokio::test]
async fn times_with_work_left_out_are_a_line_of_their_own() {
    let (_folder, store, sequence_id) = store().await;
    for skip in [Skip::Off, Skip::Exact, Skip::Off] {
        let mut new = job(sequence_id, &["ema"]);
        new.spec.run.skip = skip;
        store.enqueue(&new, T0).await.unwrap();
        let claim = store.claim(LEASE, T0).await.unwrap().unwrap();
        let results = report(&["ema"], &[30.0]);
        store.finish(&claim, &results, &environment(), T0).await.unwrap();
    }
    let mut lines = Vec::new();
    for series in store.series(&SeriesFilter::default()).await.unwrap() {
        let points = store.points(&series, "psnr", None, 9).await.unwrap();
        lines.push((series.skip, points.len()));
    }
    assert_eq!(lines, [(Some(Skip::Off), 2), (Some(Skip::Exact), 1)]);
}

#[tokio::test]
async fn every_number_comes_back_as_it_was() {
    let (_folder, store, sequence_id) = store().await;
    let claim = claimed(&store, sequence_id, &["ema"]).await;
    let psnr = [f64::INFINITY, f64::NEG_INFINITY, f64::NAN, 24.980_085_622_375_846, 0.0];
    let written = report(&["ema"], &psnr);
    let ids = store.finish(&claim, &written, &environment(), after(5)).await.unwrap();
    let frames = store.frames(ids[0]).await.unwrap();
    for (read, written) in frames.iter().zip(&written.reports[0].frames) {
        assert_eq!(read.metrics["psnr"].0.to_bits(), written.metrics["psnr"].0.to_bits());
        assert_eq!(read.times_ms, written.times_ms);
        assert_eq!(
            (
                read.index,
                read.reset,
                read.warmup,
                read.repaired_texels,
                read.non_finite_pixels
            ),
            (
                written.index,
                written.reset,
                written.warmup,
                written.repaired_texels,
                written.non_finite_pixels
            )
        );
    }
    assert_eq!(frames.len(), psnr.len());
    let read = store.report(ids[0]).await.unwrap().unwrap();
    assert_eq!(read.series.environment.adapter, written.adapter);
    assert_eq!(read.series.parameters, written.reports[0].parameters);
    assert_eq!(read.notes, written.reports[0].notes);
    assert_eq!(read.times_ms, written.reports[0].times_ms);
    assert_eq!(read.metric_versions, written.metric_versions);
    let finite = [24.980_085_622_375_846, 31.5, f64::INFINITY];
    let claim = claimed(&store, sequence_id, &["ema"]).await;
    let written = report(&["ema"], &finite);
    let ids = store.finish(&claim, &written, &environment(), after(5)).await.unwrap();
    let read = store.report(ids[0]).await.unwrap().unwrap();
    assert_eq!(read.summary, written.reports[0].summary);
    assert_eq!(read.values["psnr"], written.reports[0].summary["psnr"].mean);
    assert_eq!(read.gpu_time_ms, Some(0.75), "the sum of the passes");
    assert_eq!(read.created_at, after(5));
    assert_eq!(
        (read.provenance.branch.as_deref(), read.provenance.commit.as_deref()),
        (Some("main"), Some("0123abcd"))
    );
}

#[tokio::test]
async fn a_series_holds_what_is_comparable_in_order() {
    let (_folder, store, sequence_id) = store().await;
    for (i, psnr) in [30.0, f64::INFINITY, 32.0].into_iter().enumerate() {
        let claim = claimed(&store, sequence_id, &["ema", "inside"]).await;
        let report = report(&["ema", "inside"], &[psnr]);
        store
            .finish(&claim, &report, &environment(), after(i as u64))
            .await
            .unwrap();
    }
    let claim = claimed(&store, sequence_id, &["ema"]).await;
    let mut other_driver = report(&["ema"], &[99.0]);
    other_driver.adapter = adapter("2.0");
    store
        .finish(&claim, &other_driver, &in_environment(adapter("2.0")), after(9))
        .await
        .unwrap();

    let ema = SeriesFilter {
        preset: Some("ema".to_owned()),
        ..SeriesFilter::default()
    };
    let series = store.series(&ema).await.unwrap();
    assert_eq!(series.len(), 2, "another driver is another series");
    let points = store.points(&series[0], "psnr", None, 100).await.unwrap();
    assert_eq!(
        points.iter().map(|point| point.value.0).collect::<Vec<_>>(),
        [30.0, f64::INFINITY, 32.0]
    );
    assert!(points.is_sorted_by_key(|point| point.created_at));
    let last = store.points(&series[0], "psnr", Some("main"), 1).await.unwrap();
    assert_eq!(last[0].value.0, 32.0, "the limit keeps the newest");
    assert!(
        store
            .points(&series[0], "psnr", Some("other"), 100)
            .await
            .unwrap()
            .is_empty()
    );
    assert!(store.points(&series[0], "ssim", None, 100).await.unwrap().is_empty());
    let times = store.points(&series[0], GPU_TIME, None, 100).await.unwrap();
    assert_eq!(times.iter().map(|point| point.value.0).collect::<Vec<_>>(), [0.75; 3]);

    let latest = ReportFilter {
        latest_only: true,
        limit: 100,
        ..ReportFilter::default()
    };
    let latest = store.reports(&latest).await.unwrap();
    let values: Vec<_> = latest
        .iter()
        .map(|report| (report.series.preset.as_str(), report.values["psnr"].0))
        .collect();
    assert_eq!(values, [("ema", 99.0), ("inside", 32.0), ("ema", 32.0)]);
}

#[tokio::test]
async fn cancelling_depends_on_where_the_job_is() {
    let (_folder, store, sequence_id) = store().await;
    let queued = store.enqueue(&job(sequence_id, &["ema"]), T0).await.unwrap();
    assert_eq!(store.cancel(queued, T0).await.unwrap(), Cancelled::AtOnce);
    assert_eq!(status(&store, queued).await, Status::Cancelled);
    assert_eq!(store.cancel(queued, T0).await.unwrap(), Cancelled::TooLate);
    assert_eq!(store.cancel(999, T0).await.unwrap(), Cancelled::Unknown);

    let claim = claimed(&store, sequence_id, &["ema"]).await;
    assert!(!store.heartbeat(&claim, 0, 3, after(60)).await.unwrap());
    assert_eq!(store.cancel(claim.job_id, T0).await.unwrap(), Cancelled::Soon);
    assert!(store.heartbeat(&claim, 1, 3, after(60)).await.unwrap());
    store.finish_cancelled(&claim, T0).await.unwrap();
    assert_eq!(status(&store, claim.job_id).await, Status::Cancelled);

    // A crash between the request and the job's noticing it must not start the job again.
    let claim = claimed(&store, sequence_id, &["ema"]).await;
    store.cancel(claim.job_id, T0).await.unwrap();
    store.recover(Timestamp::MAX, T0).await.unwrap();
    assert_eq!(status(&store, claim.job_id).await, Status::Cancelled);
}

#[tokio::test]
async fn jobs_are_listed_a_page_at_a_time() {
    let (_folder, store, sequence_id) = store().await;
    for _ in 0..5 {
        store.enqueue(&job(sequence_id, &["ema"]), T0).await.unwrap();
    }
    store.cancel(2, T0).await.unwrap();
    let page = async |status, before| {
        let filter = JobFilter {
            status,
            sequence_hash: None,
            project: None,
            before,
            limit: 2,
        };
        let jobs = store.jobs(&filter).await.unwrap();
        jobs.iter().map(|job| job.id).collect::<Vec<_>>()
    };
    assert_eq!(page(None, None).await, [5, 4]);
    assert_eq!(page(None, Some(4)).await, [3, 2]);
    assert_eq!(page(Some(Status::Queued), Some(4)).await, [3, 1]);
    assert_eq!(page(Some(Status::Cancelled), None).await, [2]);
}

#[tokio::test]
async fn a_name_means_the_content_last_put_under_it() {
    let (_folder, store, _) = store().await;
    assert!(store.put_sequence(&sequence("bb", "ship"), after(1)).await.unwrap().1);
    assert_eq!(store.sequence("ship").await.unwrap().unwrap().hash, "bb");
    let (again, new) = store.put_sequence(&sequence("aa", "ship"), after(2)).await.unwrap();
    assert_eq!((again.hash.as_str(), new), ("aa", false));
    assert_eq!(store.sequence("ship").await.unwrap().unwrap().hash, "aa");
    assert_eq!(store.sequence("bb").await.unwrap().unwrap().hash, "bb");
    assert!(store.sequence("cc").await.unwrap().is_none());
    // A second name takes none away.
    for (hash, name, [ship, also]) in [("aa", "also", ["aa", "aa"]), ("bb", "also", ["aa", "bb"])] {
        store.put_sequence(&sequence(hash, name), after(3)).await.unwrap();
        assert_eq!(store.sequence("ship").await.unwrap().unwrap().hash, ship);
        assert_eq!(store.sequence_ids("also").await.unwrap().unwrap().1, also);
    }
}

#[tokio::test]
async fn what_is_no_database_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let path = database(folder.path());
    std::fs::write(
        &path,
        "this is not a database, only a long enough line of text to look at",
    )
    .unwrap();
    let error = Store::open(&path).await.err().unwrap().to_string();
    assert!(error.contains("test.sqlite"), "{error}");
}
