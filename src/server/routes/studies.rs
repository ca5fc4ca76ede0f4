//! What is studied of recipes beside their reports.

use super::{
    super::{api::Api, bench, stress},
    IMAGE_TYPES, TABLE_TYPES,
};
use crate::store::{BenchRun, Job, Scope};

/// Run time against error, and numerical stability.
pub fn studies(api: Api) -> Api {
    let (read, submit) = (Scope::Read, Scope::Submit);
    api.route(
        "GET /bench",
        read,
        ["listBenchmarks", "bench", "Benchmarks with their points"],
        bench::list,
        |o, s| {
            o.query::<bench::BenchQuery>()
                .answer::<bench::BenchPage>(s, 200, "Newest first")
        },
    )
    .route(
        "POST /bench",
        submit,
        ["createBenchmark", "bench", "Queue a sweep of settings over a sequence"],
        bench::post,
        |o, s| {
            o.body::<bench::BenchRequest>(s)
                .answer::<Job>(s, 202, "Queued; `location` says where to watch it")
        },
    )
    .route(
        "GET /bench/{job}",
        read,
        ["getBenchmark", "bench", "A job's points"],
        bench::get,
        |o, s| o.answer::<BenchRun>(s, 200, "Once the job is done"),
    )
    .route(
        "GET /bench/{job}/front.svg",
        read,
        ["getFront", "images", "Time against a metric, with the Pareto front"],
        bench::front,
        |o, _| {
            o.query::<bench::FrontQuery>()
                .media(200, "Of one sequence", &["image/svg+xml"])
        },
    )
    .route(
        "GET /bench/{job}/points.csv",
        read,
        ["exportPoints", "bench", "A job's points as a table"],
        bench::points,
        |o, _| {
            o.query::<bench::FrontQuery>()
                .media(200, "A line a point", &TABLE_TYPES[..1])
        },
    )
    .route(
        "GET /stress",
        read,
        ["listMatrices", "stress", "Matrices of stress runs, without their cells"],
        stress::list,
        |o, s| {
            o.query::<stress::StressQuery>()
                .answer::<stress::StressPage>(s, 200, "Newest first")
        },
    )
    .route(
        "POST /stress",
        submit,
        ["createMatrix", "stress", "Queue a matrix of hazards and recipes"],
        stress::post,
        |o, s| {
            o.body::<stress::StressRequest>(s)
                .answer::<Job>(s, 202, "Queued; `location` says where to watch it")
        },
    )
    .route(
        "GET /stress/{job}",
        read,
        ["getMatrix", "stress", "A job's matrix with its cells"],
        stress::get,
        |o, s| o.answer::<stress::Matrix>(s, 200, "Once the job is done"),
    )
    .route(
        "GET /stress/{job}/cells/{picture}",
        read,
        [
            "getCellImage",
            "images",
            "A cell's frames, a row each: adapter, twin, and their difference",
        ],
        stress::picture,
        |o, _| o.media(200, "Of cells that ran", &IMAGE_TYPES[..1]),
    )
}
