//! Which endpoints there are. Bodies and answers are those of the handlers; a test asks the running service whether they
//! are.

mod studies;

pub use studies::studies;

use super::{
    admin, alerts, api::Api, blobs, catalog, encoding, events, frames, jobs, judging, marks, reports, results,
    sequences, upload,
};
use crate::{
    metrics::Listing,
    run::report::AdapterInfo,
    store::{Alert, Decision, Report, Scope, Sequence, Series},
    taa::{Preset, validation::Validation},
};
use axum::Json;
use serde_json::json;

const IMAGE_TYPES: [&str; 3] = ["image/png", "image/x-exr", encoding::HALVES];
const TABLE_TYPES: [&str; 2] = ["text/csv", "application/vnd.apache.parquet"];

/// What there is, and the document itself.
pub fn catalog(api: Api) -> Api {
    let read = Scope::Read;
    api.route(
        "GET /openapi.json",
        None,
        ["getDocument", "service", "This document"],
        async || Json(super::document()),
        |o, _| o.media(200, "OpenAPI 3.1", &["application/json"]),
    )
    .route(
        "GET /health",
        None,
        ["getHealth", "service", "Whether the database answers"],
        catalog::health,
        |o, s| o.answer::<catalog::Health>(s, 200, "It does"),
    )
    .route(
        "GET /adapter",
        read,
        ["getAdapter", "service", "The adapter that runs jobs"],
        catalog::adapter,
        |o, s| o.answer::<AdapterInfo>(s, 200, "Found at start"),
    )
    .route(
        "GET /environments",
        read,
        [
            "listEnvironments",
            "service",
            "Every environment that results came from",
        ],
        catalog::environments,
        |o, s| o.answer::<catalog::EnvironmentList>(s, 200, "By number"),
    )
    .route(
        "GET /presets",
        read,
        [
            "listPresets",
            "recipes",
            "Published systems with their parameters' values",
        ],
        catalog::presets,
        |o, s| o.answer::<Vec<Preset>>(s, 200, "In the order of publication"),
    )
    .route(
        "GET /recipes",
        read,
        [
            "listRecipes",
            "recipes",
            "Published systems with every parameter's type, unit, range, default",
        ],
        catalog::recipes,
        |o, s| o.answer::<catalog::RecipeList>(s, 200, "In the order of publication"),
    )
    .route(
        "GET /recipes/{preset}",
        read,
        ["getRecipe", "recipes", "One published system"],
        catalog::recipe,
        |o, s| o.answer::<catalog::RecipeListing>(s, 200, "With every parameter's type, unit, range, default"),
    )
    .route(
        "GET /metrics",
        read,
        ["listMetrics", "recipes", "Every metric that is computed here"],
        catalog::metrics,
        |o, s| o.answer::<Vec<Listing>>(s, 200, "With unit, direction, version, masks"),
    )
    .route(
        "GET /projects",
        read,
        ["listProjects", "projects", "Every project"],
        catalog::projects,
        |o, s| o.answer::<catalog::ProjectList>(s, 200, "By name"),
    )
    .route(
        "GET /projects/{project}/branches",
        read,
        [
            "listBranches",
            "projects",
            "A project's branches with their points of departure",
        ],
        catalog::branches,
        |o, s| o.answer::<catalog::BranchList>(s, 200, "By name"),
    )
}

/// Sequences, their files, jobs over them.
pub fn sequences(api: Api) -> Api {
    let (read, submit) = (Scope::Read, Scope::Submit);
    let api = api
        .route(
            "GET /sequences",
            read,
            ["listSequences", "sequences", "Sequences"],
            sequences::list,
            |o, s| {
                o.query::<sequences::SequenceQuery>()
                    .answer::<sequences::SequencePage>(s, 200, "Newest content first")
            },
        )
        .route(
            "POST /sequences",
            submit,
            ["createSequence", "sequences", "Make a sequence of blobs"],
            sequences::post,
            |o, s| {
                let o = o
                    .body::<sequences::SequenceRequest>(s)
                    .answer::<Sequence>(s, 201, "New content");
                o.answer::<Sequence>(s, 200, "Known content, now found by this name")
            },
        )
        .route(
            "GET /sequences/{sequence}",
            read,
            [
                "getSequence",
                "sequences",
                "One sequence with its manifest and its check",
            ],
            sequences::get,
            |o, s| {
                o.answer::<sequences::Checked>(s, 200, "The one with this hash, else the one last put under this name")
            },
        )
        .route(
            "PUT /sequences/{sequence}",
            submit,
            ["putSequence", "sequences", "Send a sequence as tar, tar.gz or zip"],
            upload::put,
            |o, s| {
                let o = o.file("Streamed; unpacked within limits, checked and hashed before it is kept.");
                o.answer::<Sequence>(s, 201, "New content").answer::<Sequence>(
                    s,
                    200,
                    "Known content, now found by this name",
                )
            },
        )
        .route(
            "GET /sequences/{sequence}/archive",
            read,
            ["getArchive", "sequences", "A sequence as a tar"],
            sequences::archive,
            |o, _| o.media(200, "Made while it is sent", &["application/x-tar"]),
        )
        .route(
            "GET /sequences/{sequence}/frames/{frame}/{image}",
            read,
            ["getSequenceImage", "images", "A frame's input or reference"],
            frames::of_sequence,
            |o, _| {
                o.query::<frames::SequenceImageQuery>().media(
                    200,
                    "PNG in display values, EXR and bare halves in linear RGB",
                    &IMAGE_TYPES,
                )
            },
        )
        .route(
            "HEAD /blobs/{sha256}",
            submit,
            ["headBlob", "blobs", "Whether a file is here, or how much of it"],
            blobs::head,
            |o, _| {
                o.empty(200, "It is here")
                    .empty(204, "`upload-offset` bytes of it are here")
            },
        )
        .route(
            "PUT /blobs/{sha256}",
            submit,
            ["putBlob", "blobs", "Send a file, or the rest of it"],
            blobs::put,
            |o, s| {
                let range = json!({"type": "string", "pattern": "^bytes [0-9]{1,15}-[0-9]{1,15}/[0-9]{1,15}$"});
                let o = o
                    .file("The whole file, or the part that `content-range` names.")
                    .header("Content-Range", "`bytes FIRST-LAST/TOTAL`", range);
                o.answer::<blobs::Blob>(s, 200, "It was here")
                    .answer::<blobs::Blob>(s, 201, "It is here now")
                    .empty(202, "`upload-offset` bytes of it are here")
            },
        );
    api.route("GET /jobs", read, ["listJobs", "jobs", "Jobs"], jobs::list, |o, s| {
        o.query::<jobs::JobQuery>()
            .answer::<jobs::JobPage>(s, 200, "Newest first")
    })
    .route(
        "POST /jobs",
        submit,
        [
            "createJob",
            "jobs",
            "Queue presets to run, or images to compare, over a sequence",
        ],
        jobs::post,
        |o, s| {
            o.body::<jobs::JobRequest>(s)
                .answer::<jobs::JobWithReports>(s, 200, "The same was run before: the job that did")
                .answer::<jobs::JobWithReports>(s, 202, "Queued; `location` says where to watch it")
        },
    )
    .route(
        "GET /jobs/{job}",
        read,
        ["getJob", "jobs", "One job with its reports"],
        jobs::get,
        |o, s| o.answer::<jobs::JobWithReports>(s, 200, "Its reports once it is done"),
    )
    .route(
        "DELETE /jobs/{job}",
        submit,
        ["cancelJob", "jobs", "Cancel a job"],
        jobs::cancel,
        |o, s| {
            let o = o.answer::<jobs::JobWithReports>(s, 200, "It never ran and never will");
            o.answer::<jobs::JobWithReports>(s, 202, "It ends after its current frame")
        },
    )
    .route(
        "GET /jobs/{job}/events",
        read,
        ["followJob", "jobs", "A job's progress as server-sent events"],
        events::follow,
        |o, _| {
            let o = o.header(
                "Last-Event-ID",
                "The last event that was heard.",
                json!({"type": "string"}),
            );
            o.media(
                200,
                "`progress`, then `done`, `failed` or `cancelled`",
                &["text/event-stream"],
            )
            .empty(204, "The end was heard already")
        },
    )
}

/// Reports and what is made of them.
pub fn results(api: Api) -> Api {
    let (read, submit) = (Scope::Read, Scope::Submit);
    api.route(
        "GET /reports",
        read,
        ["listReports", "reports", "Reports"],
        reports::list,
        |o, s| {
            o.query::<reports::ReportQuery>()
                .answer::<reports::ReportPage>(s, 200, "Newest first")
        },
    )
    .route(
        "POST /reports",
        submit,
        ["createReport", "reports", "Post results measured elsewhere"],
        results::post,
        |o, s| {
            o.body::<results::ReportRequest>(s).answer::<results::Posted>(
                s,
                201,
                "Stored, and judged if rules were sent",
            )
        },
    )
    .route(
        "POST /reports/bencher",
        submit,
        [
            "createBencherReports",
            "reports",
            "Post Bencher's metric JSON: a report a benchmark",
        ],
        results::post_bencher,
        |o, s| {
            o.query::<results::BencherQuery>()
                .body::<results::BencherRequest>(s)
                .answer::<results::PostedAll>(s, 201, "Stored")
        },
    )
    .route(
        "GET /reports/{report}",
        read,
        ["getReport", "reports", "One report without its frames"],
        reports::get,
        |o, s| o.answer::<Report>(s, 200, "With summaries by metric and by pass"),
    )
    .route(
        "GET /reports/{report}/frames",
        read,
        [
            "listFrames",
            "reports",
            "Every frame's metrics and times, as JSON, CSV or Parquet",
        ],
        reports::rows,
        |o, s| {
            o.query::<reports::RowsQuery>()
                .answer::<reports::FrameList>(s, 200, "In order")
                .media(200, "", &TABLE_TYPES)
        },
    )
    .route(
        "GET /reports/{report}/validation",
        read,
        [
            "getValidation",
            "reports",
            "How far the adapter is from the twin, every pass of every frame",
        ],
        reports::validation,
        |o, s| o.answer::<Validation>(s, 200, "Of a report whose job asked for it"),
    )
    .route(
        "POST /reports/{report}/frames",
        submit,
        ["addFrames", "reports", "Add frames to an open report"],
        results::post_frames,
        |o, s| {
            o.body::<results::FramesRequest>(s)
                .answer::<results::FramesPosted>(s, 200, "Stored")
        },
    )
    .route(
        "POST /reports/{report}/close",
        submit,
        [
            "closeReport",
            "reports",
            "Summarise an open report; from now on it counts",
        ],
        results::close,
        |o, s| {
            o.body::<results::CloseRequest>(s).answer::<results::Posted>(
                s,
                200,
                "Complete, and judged if rules were sent",
            )
        },
    )
    .route(
        "GET /reports/{report}/frames/{frame}/{image}",
        read,
        [
            "getReportImage",
            "images",
            "A frame's input, output, reference, error, or map of a spatial metric",
        ],
        frames::of_report,
        |o, _| {
            o.query::<frames::ImageQuery>().media(
                200,
                "PNG in display values or false colour, EXR and bare halves as measured",
                &IMAGE_TYPES,
            )
        },
    )
    .route(
        "GET /series",
        read,
        [
            "listSeries",
            "series",
            "A metric over time, a line for each sequence, recipe and environment",
        ],
        reports::series,
        |o, s| {
            o.query::<reports::SeriesQuery>()
                .answer::<reports::TrendList>(s, 200, "Oldest point first")
        },
    )
    .route(
        "GET /series/{series}",
        read,
        ["getSeries", "series", "What the points of a line have in common"],
        reports::one_series,
        |o, s| o.answer::<Series>(s, 200, "Project, sequence, recipe, environment"),
    )
    .route(
        "GET /series/{series}/points",
        read,
        [
            "listPoints",
            "series",
            "A metric of one line, whole or thinned, as JSON, CSV or Parquet",
        ],
        reports::points,
        |o, s| {
            o.query::<reports::PointQuery>()
                .answer::<reports::PointList>(s, 200, "Oldest first")
                .media(200, "", &TABLE_TYPES)
        },
    )
    .route(
        "GET /series/{series}/marks",
        read,
        [
            "getMarks",
            "series",
            "What a chart of a line draws beside its points: limits, baseline, changes of level",
        ],
        marks::get,
        |o, s| {
            o.query::<marks::MarkQuery>()
                .answer::<marks::Marks>(s, 200, "By the rules of the branch")
        },
    )
}

/// What is good enough.
pub fn verdicts(api: Api) -> Api {
    let (read, submit, approve) = (Scope::Read, Scope::Submit, Scope::Approve);
    api.route(
        "POST /verdicts",
        submit,
        [
            "createVerdict",
            "verdicts",
            "Hold reports against rules, which become their branch's",
        ],
        judging::post,
        |o, s| {
            o.body::<judging::VerdictRequest>(s).answer::<judging::Judgement>(
                s,
                200,
                "Every check, and the alerts that are new",
            )
        },
    )
    .route(
        "GET /thresholds",
        read,
        ["listThresholds", "verdicts", "The rules of every branch, as last sent"],
        alerts::thresholds,
        |o, s| o.answer::<alerts::ThresholdList>(s, 200, "By project and branch"),
    )
    .route(
        "GET /baselines",
        read,
        [
            "listBaselines",
            "verdicts",
            "What was approved and rejected, by whom, why",
        ],
        alerts::baselines,
        |o, s| {
            o.query::<alerts::BaselineQuery>().answer::<alerts::DecisionPage>(
                s,
                200,
                "Newest first; the newest about a report counts",
            )
        },
    )
    .route(
        "POST /reports/{report}/decisions",
        approve,
        [
            "decide",
            "verdicts",
            "Approve a result into its line's baseline, or reject it",
        ],
        alerts::decide,
        |o, s| o.body::<alerts::DecisionRequest>(s).answer::<Decision>(s, 201, "Noted"),
    )
    .route(
        "GET /alerts",
        read,
        ["listAlerts", "verdicts", "Faults that were found"],
        alerts::list,
        |o, s| {
            o.query::<alerts::AlertQuery>()
                .answer::<alerts::AlertPage>(s, 200, "Newest first")
        },
    )
    .route(
        "GET /alerts/{alert}",
        read,
        ["getAlert", "verdicts", "One alert"],
        alerts::get,
        |o, s| o.answer::<Alert>(s, 200, "With the first bad commit, the last good one, and the effect"),
    )
    .route(
        "POST /alerts/{alert}/dismiss",
        approve,
        ["dismissAlert", "verdicts", "Say that an alert does not matter"],
        alerts::dismiss,
        |o, s| o.body::<alerts::Reason>(s).answer::<Alert>(s, 200, "Dismissed"),
    )
}

/// Tokens and webhooks.
pub fn admin(api: Api) -> Api {
    let admin = Scope::Admin;
    api.route(
        "GET /tokens",
        admin,
        ["listTokens", "admin", "Every token, without its text"],
        admin::tokens,
        |o, s| o.answer::<admin::TokenList>(s, 200, "By number"),
    )
    .route(
        "DELETE /tokens/{token}",
        admin,
        ["revokeToken", "admin", "Revoke a token"],
        admin::revoke,
        |o, _| o.empty(204, "Revoked; it works for at most 2 s more"),
    )
    .route(
        "GET /webhooks",
        admin,
        ["listWebhooks", "admin", "Every webhook, without its secret"],
        admin::webhooks,
        |o, s| o.answer::<admin::WebhookList>(s, 200, "By number"),
    )
    .route(
        "POST /webhooks",
        admin,
        ["createWebhook", "admin", "Tell an address of a project's verdicts"],
        admin::create_webhook,
        |o, s| {
            o.body::<admin::WebhookRequest>(s).answer::<admin::NewWebhook>(
                s,
                201,
                "With its secret, which is shown this once",
            )
        },
    )
    .route(
        "DELETE /webhooks/{webhook}",
        admin,
        ["deleteWebhook", "admin", "Remove a webhook"],
        admin::delete_webhook,
        |o, _| o.empty(204, "Removed, with what was still to be sent"),
    )
    .route(
        "GET /webhooks/{webhook}/deliveries",
        admin,
        ["listDeliveries", "admin", "What a webhook was sent"],
        admin::deliveries,
        |o, s| o.answer::<admin::DeliveryList>(s, 200, "Newest first, at most 100"),
    )
}
