//! Asks a service as much as it promises to bear, and prints how it bore it:
//! `cargo run --release --example load -- http://127.0.0.1:8080 [SECONDS] [PHASE [SEQUENCE [PRESETS]]]`.
//!
//! Frame posts, report posts, trends and mixed requests, each for a bounded number of seconds from a bounded number of
//! connections. `job` and `jobs` run jobs on a sequence that the service has: how much longer one takes beside mixed
//! requests, and how long one job of eight presets against eight of one. It speaks to this machine only: it would be an
//! attack on any other. It writes HTTP itself, because a client's own work on the same two cores would be measured too.

#![allow(clippy::print_stdout, reason = "an example's output")]

use anyhow::{Context, bail, ensure};
use serde_json::{Value, json};
use std::{
    io::{Read as _, Write as _},
    net::{SocketAddr, TcpStream},
    sync::{
        Mutex,
        atomic::{AtomicBool, AtomicU64, Ordering::Relaxed},
    },
    thread,
    time::{Duration, Instant},
};

/// More would measure the load generator.
const MAX_SECONDS: u64 = 60;
const CONNECTIONS: usize = 32;

fn main() -> anyhow::Result<()> {
    let mut arguments = std::env::args().skip(1);
    let url = arguments
        .next()
        .context("usage: load http://127.0.0.1:PORT [SECONDS] [history | mixed | job SEQUENCE [PRESETS] | jobs SEQUENCE [PRESETS]]")?;
    let seconds: u64 = arguments.next().map_or(Ok(5), |text| text.parse())?;
    ensure!((1..=MAX_SECONDS).contains(&seconds), "1 to {MAX_SECONDS} seconds");
    let address: SocketAddr = url.trim_start_matches("http://").trim_end_matches('/').parse()?;
    ensure!(
        address.ip().is_loopback(),
        "{address} is another machine; this is for 127.0.0.1 only"
    );
    let duration = Duration::from_secs(seconds);
    let phase = arguments.next();
    let sequence = arguments.next().context("name a sequence that the service has");
    let presets = arguments.next();
    let presets: Vec<&str> = presets.as_deref().unwrap_or(PRESETS).split(',').collect();
    match phase.as_deref() {
        Some("history") => history(address),
        Some("mixed") => mixed(address, |elapsed| elapsed < duration),
        Some("job") => job_beside_requests(address, &sequence?, &presets),
        Some("jobs") => one_job_or_several(address, &sequence?, &presets),
        Some(other) => bail!("there is no phase `{other}`"),
        None => {
            frames(address, duration)?;
            reports(address, duration)?;
            trends(address)?;
            mixed(address, |elapsed| elapsed < duration)
        }
    }
}

/// One connection that is kept.
struct Connection {
    stream: TcpStream,
    buffer: Vec<u8>,
}

impl Connection {
    fn open(address: SocketAddr) -> anyhow::Result<Self> {
        let stream = TcpStream::connect(address)?;
        stream.set_nodelay(true)?;
        stream.set_read_timeout(Some(Duration::from_secs(30)))?;
        Ok(Self {
            stream,
            buffer: Vec::with_capacity(1 << 20),
        })
    }

    /// Status and body of the answer.
    fn ask(&mut self, method: &str, path: &str, body: &str) -> anyhow::Result<(u16, &[u8])> {
        let request = format!(
            "{method} /api/v1{path} HTTP/1.1\r\nhost: localhost\r\ncontent-type: application/json\r\ncontent-length: {}\r\n\r\n{body}",
            body.len()
        );
        self.stream.write_all(request.as_bytes())?;
        self.buffer.clear();
        let mut chunk = [0; 65_536];
        let head = loop {
            let n = self.stream.read(&mut chunk)?;
            ensure!(n > 0, "the connection was closed");
            self.buffer.extend_from_slice(&chunk[..n]);
            if let Some(end) = self.buffer.windows(4).position(|window| window == b"\r\n\r\n") {
                break end + 4;
            }
        };
        let text = std::str::from_utf8(&self.buffer[..head])?.to_ascii_lowercase();
        let status: u16 = text.split(' ').nth(1).context("no status")?.parse()?;
        let length = text
            .lines()
            .find_map(|line| line.strip_prefix("content-length: ")?.parse::<usize>().ok());
        let length = length.context("no length")?;
        while self.buffer.len() < head + length {
            let n = self.stream.read(&mut chunk)?;
            ensure!(n > 0, "the connection was closed");
            self.buffer.extend_from_slice(&chunk[..n]);
        }
        Ok((status, &self.buffer[head..head + length]))
    }

    fn json(&mut self, method: &str, path: &str, body: &Value) -> anyhow::Result<Value> {
        let (status, answer) = self.ask(method, path, &body.to_string())?;
        ensure!(
            (200..300).contains(&status),
            "{status}: {}",
            String::from_utf8_lossy(answer)
        );
        Ok(serde_json::from_slice(answer)?)
    }
}

/// Times of requests, milliseconds.
#[derive(Default)]
struct Times(Mutex<Vec<f64>>);

impl Times {
    fn add(&self, start: Instant) {
        self.0
            .lock()
            .expect("no thread panics")
            .push(start.elapsed().as_secs_f64() * 1e3);
    }

    fn print_with_rate(&self, what: &str, elapsed: Duration) {
        let n = self.0.lock().expect("no thread panics").len();
        let seconds = elapsed.as_secs_f64();
        self.print(&format!("{what}, {n} in {seconds:.1} s, {:.0}/s", n as f64 / seconds));
    }

    fn print(&self, what: &str) {
        let mut times = self.0.lock().expect("no thread panics").clone();
        times.sort_by(f64::total_cmp);
        let at = |share: f64| {
            times
                .get(((times.len() - 1) as f64 * share) as usize)
                .copied()
                .unwrap_or(f64::NAN)
        };
        println!("{what}: ms p50 {:.2}, p99 {:.2}, max {:.2}", at(0.5), at(0.99), at(1.0));
    }
}

/// Every connection sends as fast as it is answered.
fn flood(
    address: SocketAddr,
    duration: Duration,
    what: &str,
    request: impl Fn(usize, u64) -> (String, String, String) + Sync,
) -> anyhow::Result<()> {
    let times = Times::default();
    let (start, failed) = (Instant::now(), AtomicBool::new(false));
    thread::scope(|scope| {
        for connection in 0..CONNECTIONS {
            let (request, times, failed) = (&request, &times, &failed);
            scope.spawn(move || {
                let outcome = (|| -> anyhow::Result<()> {
                    let mut client = Connection::open(address)?;
                    for i in 0.. {
                        if start.elapsed() >= duration {
                            break;
                        }
                        let (method, path, body) = request(connection, i);
                        let sent = Instant::now();
                        let (status, answer) = client.ask(&method, &path, &body)?;
                        ensure!(
                            (200..300).contains(&status),
                            "{status}: {}",
                            String::from_utf8_lossy(answer)
                        );
                        times.add(sent);
                    }
                    Ok(())
                })();
                if let Err(error) = outcome {
                    println!("{what}: {error:#}");
                    failed.store(true, Relaxed);
                }
            });
        }
    });
    times.print_with_rate(what, start.elapsed());
    ensure!(!failed.load(Relaxed), "some requests failed");
    Ok(())
}

fn frame(index: u64) -> Value {
    let x = (index % 97) as f64;
    json!({"index": index, "metrics": {"psnr": 30.0 + x / 7.0, "ssim": 0.9 + x / 1e4, "flip": 0.05 + x / 1e5}, "times_ms": {"taa": 0.4 + x / 1e3}})
}

fn frames(address: SocketAddr, duration: Duration) -> anyhow::Result<()> {
    let mut client = Connection::open(address)?;
    let open = |_| {
        client.json(
            "POST",
            "/reports",
            &json!({"sequence": "load-frames", "system": "load", "open": true}),
        )
    };
    let ids: Vec<Value> = (0..CONNECTIONS).map(open).collect::<anyhow::Result<_>>()?;
    flood(address, duration, "posts of one frame", |connection, i| {
        let body = json!({"frames": [frame(i)]}).to_string();
        (
            "POST".to_owned(),
            format!("/reports/{}/frames", ids[connection]["id"]),
            body,
        )
    })
}

fn reports(address: SocketAddr, duration: Duration) -> anyhow::Result<()> {
    let frames: Vec<Value> = (0..60).map(frame).collect();
    // Serialised once: the service's time is what is measured.
    let frames = serde_json::to_string(&frames)?;
    flood(address, duration, "reports of 60 frames", |connection, i| {
        let body = format!(
            "{{\"sequence\":\"load-{}\",\"system\":\"load\",\"branch\":\"main\",\"commit\":\"{connection}-{i}\",\"frames\":{frames}}}",
            connection % 8
        );
        ("POST".to_owned(), "/reports".to_owned(), body)
    })
}

/// A line of 100 000 points and a million frame rows beside it.
fn history(address: SocketAddr) -> anyhow::Result<()> {
    let counter = AtomicU64::new(0);
    let next = || counter.fetch_add(1, Relaxed);
    let start = Instant::now();
    let many = |n: u64, what: &str, body: &(dyn Fn(u64) -> String + Sync)| -> anyhow::Result<()> {
        counter.store(0, Relaxed);
        thread::scope(|scope| {
            let threads: Vec<_> = (0..CONNECTIONS)
                .map(|_| {
                    scope.spawn(|| -> anyhow::Result<()> {
                        let mut client = Connection::open(address)?;
                        loop {
                            let i = next();
                            if i >= n {
                                return Ok(());
                            }
                            let (status, answer) = client.ask("POST", "/reports", &body(i))?;
                            ensure!(status == 201, "{status}: {}", String::from_utf8_lossy(answer));
                        }
                    })
                })
                .collect();
            threads
                .into_iter()
                .try_for_each(|thread| thread.join().expect("no thread panics"))
        })?;
        println!("{what}: {n} after {:.0} s", start.elapsed().as_secs_f64());
        Ok(())
    };
    let frames = serde_json::to_string(&(0..60).map(frame).collect::<Vec<_>>())?;
    many(16_700, "reports of 60 frames", &|i| {
        format!(
            "{{\"sequence\":\"history-{}\",\"system\":\"load\",\"branch\":\"main\",\"commit\":\"{i}\",\"frames\":{frames}}}",
            i % 33
        )
    })?;
    many(100_000, "points of one line", &|i| {
        let x = 30.0 + (i % 101) as f64 / 50.0 + if i > 60_000 { 1.0 } else { 0.0 };
        format!(
            "{{\"sequence\":\"long\",\"system\":\"load\",\"branch\":\"main\",\"commit\":\"{i}\",\"values\":{{\"psnr\":{x}}}}}"
        )
    })
}

fn trends(address: SocketAddr) -> anyhow::Result<()> {
    let mut client = Connection::open(address)?;
    let mut series = |sequence: &str| -> anyhow::Result<Option<i64>> {
        let list = client.json(
            "GET",
            &format!("/series?metric=psnr&sequence={sequence}&limit=1"),
            &Value::Null,
        )?;
        Ok(list["series"][0]["series_id"].as_i64())
    };
    let lines = [
        (series("history-0")?, "a trend of 500 points", "limit=500"),
        (series("long")?, "100 000 points thinned to 4 000", "max_points=4000"),
    ];
    for (id, what, query) in lines {
        let Some(id) = id else {
            println!("{what}: there is no history; run the phase `history` first");
            continue;
        };
        let times = Times::default();
        let mut n_points = 0;
        for _ in 0..50 {
            // Nobody is given an answer of before it.
            client.json(
                "POST",
                "/reports",
                &json!({"sequence": "between", "system": "load", "values": {"psnr": 30}}),
            )?;
            let sent = Instant::now();
            let (status, answer) = client.ask(
                "GET",
                &format!("/series/{id}/points?metric=psnr&branch=main&{query}"),
                "",
            )?;
            times.add(sent);
            ensure!(status == 200, "{status}");
            n_points = serde_json::from_slice::<Value>(answer)?["points"]
                .as_array()
                .map_or(0, Vec::len);
        }
        times.print(&format!("{what} ({n_points} given)"));
    }
    Ok(())
}

/// 500 requests a second, as long as wanted: posts, lists, trends, single reports.
fn mixed(address: SocketAddr, wanted: impl Fn(Duration) -> bool + Sync) -> anyhow::Result<()> {
    const RATE: u64 = 500;
    let times = Times::default();
    let (start, next) = (Instant::now(), AtomicU64::new(0));
    let frames = serde_json::to_string(&(0..10).map(frame).collect::<Vec<_>>())?;
    let mut client = Connection::open(address)?;
    let first = client.json(
        "POST",
        "/reports",
        &json!({"sequence": "mixed-0", "system": "load", "branch": "main", "values": {"psnr": 30}}),
    )?;
    let report = client.json("GET", &format!("/reports/{}", first["id"]), &Value::Null)?;
    let (id, series) = (&first["id"], &report["series_id"]);
    thread::scope(|scope| {
        let threads: Vec<_> = (0..CONNECTIONS)
            .map(|_| {
                scope.spawn(|| -> anyhow::Result<()> {
                    let mut client = Connection::open(address)?;
                    loop {
                        let i = next.fetch_add(1, Relaxed);
                        // A request's time counts from when it was due, so that waiting for a connection counts too.
                        let due = start + Duration::from_secs_f64(i as f64 / RATE as f64);
                        if !wanted(due - start) {
                            return Ok(());
                        }
                        thread::sleep(due.saturating_duration_since(Instant::now()));
                        let (status, _) = match i % 5 {
                            0 => {
                                let body = format!("{{\"sequence\":\"mixed-{}\",\"system\":\"load\",\"branch\":\"main\",\"commit\":\"{i}\",\"frames\":{frames}}}", i % 4);
                                client.ask("POST", "/reports", &body)?
                            }
                            1 => client.ask("GET", &format!("/series/{series}/points?metric=psnr&limit=200"), "")?,
                            2 => client.ask("GET", &format!("/reports/{id}"), "")?,
                            3 => client.ask("GET", "/reports?limit=20", "")?,
                            _ => client.ask("GET", "/jobs?limit=20", "")?,
                        };
                        ensure!((200..300).contains(&status), "{status}");
                        times.add(due);
                    }
                })
            })
            .collect();
        threads
            .into_iter()
            .try_for_each(|thread| thread.join().expect("no thread panics"))
    })?;
    times.print_with_rate("mixed requests", start.elapsed());
    Ok(())
}

/// How long a job may take, queued and run.
const MAX_JOB: Duration = Duration::from_secs(300);

/// Runs a job of these presets, and gives how long that took.
fn job(address: SocketAddr, sequence: &str, presets: &[&str], images: &str, skip: &str) -> anyhow::Result<Duration> {
    let mut client = Connection::open(address)?;
    let start = Instant::now();
    let job = client.json(
        "POST",
        "/jobs",
        &json!({"sequence": sequence, "presets": presets, "images": images, "skip": skip, "force": true}),
    )?;
    let path = format!("/jobs/{}", job["id"]);
    while start.elapsed() < MAX_JOB {
        thread::sleep(Duration::from_millis(5));
        let job = client.json("GET", &path, &Value::Null)?;
        match job["status"].as_str() {
            Some("queued" | "running") => {}
            Some("done") => return Ok(start.elapsed()),
            _ => bail!("the job ended otherwise: {job}"),
        }
    }
    bail!("the job took longer than {MAX_JOB:?}")
}

/// Eight that other work is measured with, too.
const PRESETS: &str = "none,ema,smaa1tx,inside,uncharted4,karis2014,salvi2016,inside_ycocg";

/// A job alone, beside mixed requests and so on by turns: the machine's speed changes, and the ratio is to the jobs before
/// and after.
fn job_beside_requests(address: SocketAddr, sequence: &str, presets: &[&str]) -> anyhow::Result<()> {
    const TIMES: usize = 10;
    let run = || anyhow::Ok(job(address, sequence, presets, "none", "off")?.as_secs_f64());
    run().context("warming up")?;
    let mut ratios = Vec::with_capacity(TIMES);
    let mut before = run()?;
    for _ in 0..TIMES {
        let ended = AtomicBool::new(false);
        let beside = thread::scope(|scope| {
            let requests = scope.spawn(|| mixed(address, |_| !ended.load(Relaxed)));
            let beside = run();
            ended.store(true, Relaxed);
            requests.join().expect("no thread panics")?;
            beside
        })?;
        let after = run()?;
        let ratio = beside / ((before + after) / 2.0);
        println!("a job: {before:.2} s, beside mixed requests {beside:.2} s, {after:.2} s; ratio {ratio:.3}");
        ratios.push(ratio);
        before = after;
    }
    ratios.sort_by(f64::total_cmp);
    println!(
        "median of {TIMES}: {:.3}",
        f64::midpoint(ratios[TIMES / 2 - 1], ratios[TIMES / 2])
    );
    Ok(())
}

/// One job of all presets against a job for each, by turns.
fn one_job_or_several(address: SocketAddr, sequence: &str, presets: &[&str]) -> anyhow::Result<()> {
    const TIMES: usize = 5;
    for (images, skip) in [("none", "off"), ("none", "exact"), ("half", "off")] {
        let run = |presets: &[&str]| anyhow::Ok(job(address, sequence, presets, images, skip)?.as_secs_f64());
        run(presets).context("warming up")?;
        for _ in 0..TIMES {
            let together = run(presets)?;
            let single: f64 = presets.iter().map(|preset| run(&[preset])).sum::<anyhow::Result<_>>()?;
            let (n, ratio) = (presets.len(), together / single);
            println!("images {images}, skip {skip}: one job {together:.2} s, {n} jobs {single:.2} s; ratio {ratio:.3}");
        }
    }
    Ok(())
}
