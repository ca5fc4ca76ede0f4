//! Lines in the store: whose points a branch has, that long ones are whole, and which posts share a transaction.

use crate::store::{database, environment, frame, store};
use afterimage::{
    run::report::FrameReport,
    store::{
        DEFAULT_PROJECT, Departure, Keep, KeptAnswer, NewReport, Provenance, SeriesFilter, State, Store, StoreError,
        Subject, System, SystemKind, Timestamp, condense,
    },
};
use std::{
    collections::BTreeMap,
    time::{Duration, Instant},
};

/// A report of a system elsewhere.
pub fn external(branch: &str, commit: &str, psnr: &[f64]) -> NewReport {
    let frames: Vec<FrameReport> = psnr.iter().enumerate().map(|(i, &x)| frame(i, x)).collect();
    let (metrics, times_ms) = condense(&frames, &BTreeMap::new());
    NewReport {
        job: None,
        project: DEFAULT_PROJECT.to_owned(),
        subject: Subject::Named("bistro".to_owned()),
        system: System {
            kind: SystemKind::External,
            name: "engine".to_owned(),
            history: None,
            skip: None,
            n_frames: None,
            parameters: serde_json::json!({}),
            overrides: serde_json::json!({}),
        },
        environment: environment(),
        provenance: Provenance {
            branch: Some(branch.to_owned()),
            from: (branch != "main").then(|| Departure {
                branch: "main".to_owned(),
                commit: Some("c3".to_owned()),
            }),
            commit: Some(commit.to_owned()),
            ..Provenance::default()
        },
        revision: String::new(),
        notes: Vec::new(),
        stages_ms: BTreeMap::new(),
        metrics,
        times_ms,
        frames,
        validation: None,
        complete: true,
    }
}

async fn values(store: &Store, branch: Option<&str>, limit: usize) -> Vec<f64> {
    let series = store.series(&SeriesFilter::default()).await.unwrap();
    let points = store.points(&series[0], "psnr", branch, limit).await.unwrap();
    points.iter().map(|point| point.value.0).collect()
}

#[tokio::test]
async fn a_branch_has_its_parents_past_and_not_its_present() {
    let (_folder, store, _) = store().await;
    for i in 1..=5 {
        let report = external("main", &format!("c{i}"), &[0.0, f64::from(i)]);
        store.ingest().report(report).await.unwrap();
    }
    for i in [30, 31] {
        store
            .ingest()
            .report(external("topic", "t", &[0.0, f64::from(i)]))
            .await
            .unwrap();
    }
    store
        .ingest()
        .report(external("main", "c6", &[0.0, 6.0]))
        .await
        .unwrap();
    assert_eq!(values(&store, Some("topic"), 100).await, [1.0, 2.0, 3.0, 30.0, 31.0]);
    assert_eq!(values(&store, Some("main"), 3).await, [4.0, 5.0, 6.0]);
    assert_eq!(values(&store, None, 4).await, [5.0, 30.0, 31.0, 6.0]);
    assert_eq!(values(&store, Some("nowhere"), 100).await, [0.0; 0]);
}

fn kept(ids: &[i64]) -> KeptAnswer {
    KeptAnswer {
        fingerprint: [7; 32],
        status: 201,
        headers: Vec::new(),
        body: format!("{ids:?}").into_bytes(),
    }
}

#[tokio::test]
async fn an_answer_is_kept_with_its_result_or_not_at_all() {
    let (_folder, store, _) = store().await;
    let keep = |key: &str| Keep {
        token_id: 0,
        key: key.to_owned(),
        answer: Box::new(kept),
    };
    let reports = ["c1", "c2"].map(|commit| external("main", commit, &[1.0, 2.0]));
    let ids = store
        .ingest()
        .keeping(Some(keep("a")))
        .reports(reports.into())
        .await
        .unwrap();
    let found = store.kept_answer(0, "a").await.unwrap();
    assert_eq!((found, ids.len()), (Some(kept(&ids)), 2));
    let closed = store
        .ingest()
        .keeping(Some(keep("b")))
        .close(ids[0], BTreeMap::new())
        .await;
    assert!(matches!(closed, Err(StoreError::Closed(_))), "{closed:?}");
    assert_eq!(store.kept_answer(0, "b").await.unwrap(), None);
}

#[tokio::test]
async fn an_answer_is_kept_however_much_waits() {
    let (_folder, store, _) = store().await;
    let posts = (0..2500).map(|_| store.ingest().report(external("main", "c", &[1.0])));
    let keeps = (0..50).map(|i| store.ingest().keep(0, i.to_string(), kept(&[i])));
    let (posted, kept) = tokio::join!(
        futures_util::future::join_all(posts),
        futures_util::future::try_join_all(keeps)
    );
    let n_busy = posted
        .iter()
        .filter(|posted| matches!(posted, Err(StoreError::Busy)))
        .count();
    assert!(n_busy > 0, "not so much waited");
    kept.unwrap();
}

#[tokio::test]
async fn long_lines_are_whole_whoever_wrote_them() {
    let (folder, store, _) = store().await;
    let n = 700;
    let post = |i: u32| store.ingest().report(external("main", "c", &[0.0, f64::from(i)]));
    let first = store
        .ingest()
        .report(NewReport {
            complete: false,
            ..external("main", "open", &[])
        })
        .await
        .unwrap();
    futures_util::future::try_join_all((0..n).map(post)).await.unwrap();
    let all = values(&store, Some("main"), 10_000).await;
    assert_eq!(all, (0..n).map(f64::from).collect::<Vec<_>>());
    // A report whose frames came one by one belongs where it was begun, although a block is there already.
    for (i, x) in [(0, 7.0), (1, -1.0)] {
        store.ingest().frames(first, vec![frame(i, x)]).await.unwrap();
    }
    assert!(!store.report(first).await.unwrap().unwrap().complete);
    store.ingest().close(first, BTreeMap::new()).await.unwrap();
    assert!(matches!(
        store.ingest().frames(first, vec![frame(2, 1.0)]).await,
        Err(StoreError::Closed(_))
    ));
    assert!(matches!(
        store.ingest().close(99_999, BTreeMap::new()).await,
        Err(StoreError::NoReport(_))
    ));
    drop(store);
    // Another process counts on from what is there.
    let store = Store::open(&database(folder.path())).await.unwrap();
    for i in n..n + 100 {
        store
            .ingest()
            .report(external("main", "c", &[0.0, f64::from(i)]))
            .await
            .unwrap();
    }
    let all = values(&store, Some("main"), 10_000).await;
    assert_eq!(
        all,
        [-1.0]
            .into_iter()
            .chain((0..n + 100).map(f64::from))
            .collect::<Vec<_>>()
    );
    assert_eq!(store.frames(first).await.unwrap().len(), 2);
}

#[tokio::test]
async fn posts_share_a_transaction_where_they_gather() {
    const DISTANCE: Duration = Duration::from_millis(40);
    let (_folder, store, _) = store().await;
    let post = async |commit: &str| store.ingest().report(external("main", commit, &[1.0])).await.unwrap();
    store.ingest().gather(true);
    let start = Instant::now();
    post("c0").await;
    let state = store.state().all.unwrap();
    let late = async {
        // While the other waits.
        tokio::time::sleep(DISTANCE / 8).await;
        post("c2").await;
    };
    tokio::join!(post("c1"), late);
    assert!(start.elapsed() >= DISTANCE);
    assert_eq!(store.state().all, Some(state + 1));
    store.ingest().gather(false);
    post("c3").await;
    post("c4").await;
    assert_eq!(store.state().all, Some(state + 3));
}

#[tokio::test]
async fn writes_lead_to_another_state_and_reads_do_not() {
    let (_folder, store, _) = store().await;
    let numbers = || {
        let State { all, lasting } = store.state();
        (all.unwrap(), lasting.unwrap())
    };
    let (all, lasting) = numbers();
    let id = store.ingest().report(external("main", "c0", &[1.0])).await.unwrap();
    assert_eq!(numbers(), (all + 1, lasting));
    values(&store, None, 1).await;
    store.report(id).await.unwrap().unwrap();
    assert_eq!(numbers(), (all + 1, lasting));
    store.forget_before(Timestamp::now()).await.unwrap();
    assert_eq!(numbers(), (all + 3, lasting + 2));
}
