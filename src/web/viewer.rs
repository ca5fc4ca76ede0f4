//! `/reports/{id}/frames/{frame}`: a frame's images beside each other; with scripts, two of them on one canvas down to single
//! pixels. Another report may lie beside it: `?with=`. The script keeps the address up to date.

use super::{
    format,
    layout::{Page, PageError, script_data},
    parts,
    query::{Query, href},
    report::{find, has_images, name, sorted_by},
};
use crate::{
    metrics::{Better, Display, Metric},
    run::Trace,
    server::{ApiError, ApiPath, DEFAULT_MAX_ERROR, Service, Shared, trace_file},
    store::{Report, ReportFilter},
    verdict::better,
};
use axum::{
    extract::{RawQuery, State},
    response::Html,
};
use maud::{Markup, html};
use serde::Serialize;
use std::sync::Arc;

/// Narrower than a column of the page, in pixels.
const MAX_SMALL_WIDTH: u32 = 320;
/// Newest reports that are offered to be laid beside this one.
const MAX_OTHERS: u32 = 20;

#[derive(Serialize)]
struct Data {
    report: i64,
    frame: usize,
    n_frames: usize,
    display: Display,
    metric: Option<String>,
    lower_is_better: bool,
    other: Option<i64>,
    images: Vec<ImageData>,
}

#[derive(Serialize)]
struct ImageData {
    id: String,
    name: String,
    is_map: bool,
}

/// What is looked at.
struct View {
    report: Arc<Report>,
    other: Option<Arc<Report>>,
    /// Of the same job, to change to or to lay beside.
    siblings: Vec<Arc<Report>>,
    /// Older ones of the same line.
    earlier: Vec<Arc<Report>>,
    frame: usize,
    n_frames: usize,
    has_reference: bool,
    traces: Vec<Trace>,
    /// Of the other report.
    other_traces: Vec<Trace>,
    is_small: bool,
    metric: Option<String>,
}

/// `GET /reports/{report}/frames/{frame}`
pub async fn page(
    State(service): Shared,
    ApiPath((id, frame)): ApiPath<(i64, usize)>,
    RawQuery(query): RawQuery,
) -> Result<Html<String>, PageError> {
    let query = Query::parse(query.as_deref());
    let report = find(&service, id).await?;
    let hash = report.series.sequence_hash.clone().unwrap_or_default();
    let sequence = service.store.sequence(&hash).await?;
    let Some(sequence) = sequence.filter(|_| report.job_id.is_some()) else {
        let detail = format!("report {id} has no images: only its numbers were posted; /reports/{id} shows them");
        return Err(ApiError::not_found(detail).into());
    };
    if !has_images(&service, &report).await? {
        return Err(ApiError::not_found(format!("report {id} has no images: its job kept none")).into());
    }
    let n_frames = service.store.frames(id).await?.len();
    if frame >= n_frames {
        let detail = format!(
            "there is no frame {frame}; the report has 0 to {}",
            n_frames.saturating_sub(1)
        );
        return Err(ApiError::not_found(detail).into());
    }
    let other = match query.number("with") {
        // One without images cannot lie beside.
        Some(other) => {
            let other = find(&service, other).await?;
            has_images(&service, &other).await?.then_some(other)
        }
        None => None,
    };
    let view = View {
        metric: sorted_by(&report, query.one("metric")),
        siblings: reports(&service, |filter| filter.job_id = report.job_id).await?,
        earlier: reports(&service, |filter| filter.series_id = Some(report.series.id)).await?,
        has_reference: sequence
            .manifest
            .get("reference")
            .is_some_and(|reference| !reference.is_null()),
        traces: traces(&service, &report, frame),
        other_traces: other
            .as_ref()
            .map_or_else(Vec::new, |other| traces(&service, other, frame)),
        is_small: sequence.output_size.width <= MAX_SMALL_WIDTH,
        report,
        other,
        frame,
        n_frames,
    };
    let display = sequence.manifest.get("display").filter(|display| !display.is_null());
    let display = match display {
        Some(display) => serde_json::from_value(display.clone()).map_err(ApiError::internal)?,
        None => Display::default(),
    };
    let content = html! {
        (view.heading())
        (view.steps())
        (view.stage())
        (view.figures(&query))
        (view.beside())
        (script_data(&view.data(display))?)
    };
    let title = format!("Frame {frame} of report {id}");
    let page = Page {
        title: &title,
        section: None,
        script: Some("viewer.js"),
        charts: false,
        content,
    };
    Ok(page.render(&service))
}

async fn reports(service: &Service, narrow: impl FnOnce(&mut ReportFilter)) -> Result<Vec<Arc<Report>>, PageError> {
    let mut filter = ReportFilter {
        limit: MAX_OTHERS,
        ..ReportFilter::default()
    };
    narrow(&mut filter);
    Ok(service.store.reports(&filter).await?)
}

/// How the frame's image came about, as far as that was kept.
fn traces(service: &Service, report: &Report, frame: usize) -> Vec<Trace> {
    let is_kept = |trace: &Trace| trace_file(service, report, frame, *trace).is_some();
    Trace::ALL.into_iter().filter(is_kept).collect()
}

fn named(trace: Trace) -> &'static str {
    match trace {
        Trace::HistoryShare => "share of history",
        Trace::SkippedTiles => "skipped tiles",
    }
}

/// The metrics of a report that have a map.
fn maps(report: &Report) -> Vec<&String> {
    let has_map = |id: &&String| id.parse().is_ok_and(|metric: Metric| metric.check_map().is_ok());
    report.values.keys().filter(has_map).collect()
}

impl View {
    fn data(&self, display: Display) -> Data {
        let image = |id: String, name: String, is_map| ImageData { id, name, is_map };
        let mut images = vec![
            image("output".into(), "output".into(), false),
            image("input".into(), "input".into(), false),
        ];
        if self.has_reference {
            images.push(image("reference".into(), "reference".into(), false));
            images.push(image("error".into(), "error".into(), true));
            images.extend(
                maps(&self.report)
                    .into_iter()
                    .map(|map| image(map.clone(), map.clone(), true)),
            );
        }
        let of_traces = self.traces.iter();
        images.extend(of_traces.map(|&trace| image(trace.id().into(), named(trace).into(), true)));
        if let Some(other) = &self.other {
            let name = name(other);
            images.push(image("with:output".into(), format!("{name}: output"), false));
            if self.has_reference {
                images.push(image("with:error".into(), format!("{name}: error"), true));
                let maps = maps(other).into_iter();
                images.extend(maps.map(|map| image(format!("with:{map}"), format!("{name}: {map}"), true)));
            }
            let of_traces = self.other_traces.iter();
            images.extend(of_traces.map(|&trace| {
                let name = format!("{name}: {}", named(trace));
                image(format!("with:{}", trace.id()), name, true)
            }));
        }
        Data {
            report: self.report.id,
            frame: self.frame,
            n_frames: self.n_frames,
            display,
            lower_is_better: self.metric.as_deref().and_then(better) != Some(Better::Higher),
            metric: self.metric.clone(),
            other: self.other.as_ref().map(|other| other.id),
            images,
        }
    }

    fn at(&self, report: i64, frame: usize, with: Option<i64>) -> String {
        let path = format!("/reports/{report}/frames/{frame}");
        href(
            &path,
            [("with", with.map(|id| id.to_string())), ("metric", self.metric.clone())],
        )
    }

    fn heading(&self) -> Markup {
        let report = &self.report;
        html! {
            h1 { (report.series.sequence_name) span.muted { " · " (name(report)) } }
            ul.facts {
                li { a href={ "/reports/" (report.id) } { "Report " (report.id) } }
                li { (parts::revision(&report.provenance)) }
                @if let Some(other) = &self.other {
                    li { span.key { "beside it " } a href={ "/reports/" (other.id) } { (name(other)) } " "
                        a href=(self.at(report.id, self.frame, None)) { "without" } }
                }
            }
        }
    }

    /// From frame to frame: links, which the script's keys and slider stand in for.
    fn steps(&self) -> Markup {
        let with = self.other.as_ref().map(|other| other.id);
        let to = |frame: usize| self.at(self.report.id, frame, with);
        html! {
            noscript { p.pages {
                @if self.frame > 0 { a rel="prev" href=(to(self.frame - 1)) { "← Previous frame" } }
                span { "frame " (self.frame) " of " (self.n_frames - 1) }
                @if self.frame + 1 < self.n_frames { a rel="next" href=(to(self.frame + 1)) { "Next frame →" } }
            } }
        }
    }

    /// What the script fills.
    fn stage(&self) -> Markup {
        let data = self.data(Display::default());
        let choice = |label: &str, id: &str| {
            html! { label { (label) select #(id) { @for image in &data.images { option value=(image.id) { (image.name) } } } } }
        };
        html! {
            div #viewer hidden {
                div.controls {
                    (choice("A", "a"))
                    button #swap type="button" title="x" aria-label="Swap A and B" { "⇄" }
                    (choice("B", "b"))
                    fieldset.modes { legend.unseen { "Mode" }
                        @for (i, (mode, name)) in [("one", "A"), ("swipe", "Swipe"), ("side", "Side by side"), ("blink", "Blink"), ("difference", "Difference")].iter().enumerate() {
                            label title=(i + 1) { input type="radio" name="mode" value=(mode); span { (name) } }
                        }
                    }
                }
                div #stage tabindex="0" role="group" aria-label="Images A and B. Drag or shift and arrows to move, wheel or + and − to zoom." {
                    canvas #canvas {} canvas #overlay {}
                }
                p #pixel aria-live="off" { "outside the image" }
                p #trouble role="alert" {}
                div.controls {
                    div.frame {
                        button #previous type="button" aria-label="Previous frame" title="Left arrow" { "←" }
                        button #play type="button" title="Space" aria-pressed="false" { "Play" }
                        button #next type="button" aria-label="Next frame" title="Right arrow" { "→" }
                        input #frame type="range" min="0" max=(self.n_frames - 1) value=(self.frame) aria-label="Frame";
                        output #frame-text for="frame" { "frame " (self.frame) " of " (self.n_frames - 1) }
                        @if let Some(metric) = &self.metric { button #worst type="button" title="n" { "Next worst " (metric) } }
                    }
                }
                div.controls {
                    div.frame.zooms {
                        button #farther type="button" aria-label="Smaller" title="-" { "−" }
                        button #closer type="button" aria-label="Larger" title="+" { "+" }
                        button #fit type="button" title="0" { "Fit" }
                        button #actual type="button" title="z" { "1:1" }
                    }
                    label { "Exposure " input #ev type="range" min="-10" max="10" step="0.5" value="0"; }
                    output #ev-text for="ev" { "0 EV" }
                    label { "Show" select #shown {
                        @for (id, name) in [("color", "colour"), ("red", "red"), ("green", "green"), ("blue", "blue"), ("luminance", "luminance in stops")] { option value=(id) { (name) } }
                    } }
                    label { "Difference shown up to" input #white type="number" min="0.001" max="1" step="any" value="0.1"; }
                    span #scale hidden { "0 " img.scale src=(super::assets::url("scale.png")) alt="black to white"; " most" }
                    span.files { a #exr-a href="#" { "A as EXR" } " " a #exr-b href="#" { "B as EXR" } }
                }
                details { summary { "Keys" } (keys()) }
            }
        }
    }

    /// The images themselves, which need no script.
    fn figures(&self, query: &Query) -> Markup {
        let base = format!("/api/v1/reports/{}/frames/{}", self.report.id, self.frame);
        let map = query
            .one("map")
            .filter(|id| maps(&self.report).iter().any(|map| map == id))
            .unwrap_or("error");
        let white = if map == "error" {
            format!("?max={DEFAULT_MAX_ERROR}")
        } else {
            String::new()
        };
        let other = self
            .other
            .as_ref()
            .map(|other| format!("/api/v1/reports/{}/frames/{}", other.id, self.frame));
        let figure = |base: &str, file: &str, name: &str, query: &str| {
            let png = format!("{base}/{file}.png{query}");
            html! { figure {
                a href=(png) { img src=(png) loading="lazy" alt={ (name) " of frame " (self.frame) }; }
                figcaption { b { (name) } a href={ (base) "/" (file) ".exr" } { "EXR" } }
            } }
        };
        html! {
            div #figures { noscript {
                div.images.pixelated[self.is_small] {
                    (figure(&base, "output", "Output", ""))
                    @if let (Some(other), Some(report)) = (&other, &self.other) { (figure(other, "output", &name(report), "")) }
                    (figure(&base, "input", "Input", ""))
                    @if self.has_reference {
                        (figure(&base, "reference", "Reference", ""))
                        (figure(&base, map, map, &white))
                    }
                    @for trace in &self.traces { (figure(&base, trace.id(), named(*trace), "")) }
                }
                @if self.has_reference { form.controls {
                    (parts::select("Map", "map", parts::same(["error"].into_iter().chain(maps(&self.report).into_iter().map(String::as_str))), map, None))
                    button { "Show" }
                } }
            } }
            p.muted { "As the sequence's display transform shows them. Error: mean of |output − reference| over red, green and blue in display values; pixels that are not finite are magenta. Maps of metrics: black where they are perfect. Share of history: white where a pixel is all history, black where it is all this frame. Skipped tiles: white where nothing had to be computed. Values are linear, to 11 bits." }
        }
    }

    /// Other recipes of the job, and earlier results of the same line.
    fn beside(&self) -> Markup {
        let others = |title: &str, reports: &[Arc<Report>], commit: bool| {
            let others: Vec<&Arc<Report>> = reports.iter().filter(|other| other.id != self.report.id).collect();
            html! { @if !others.is_empty() {
                h2 { (title) }
                ul.others { @for other in others {
                    li { a href=(self.at(self.report.id, self.frame, Some(other.id))) {
                            @if commit { "report " (other.id) @if let Some(commit) = &other.provenance.commit { ", " (format::short_hash(commit)) } }
                            @else { (parts::recipe(&other.series)) } }
                        " " a.muted href=(self.at(other.id, self.frame, None)) { "alone" } }
                } }
            } }
        };
        html! {
            (others("Another recipe of this job beside it", &self.siblings, false))
            (others("Another result of this line beside it", &self.earlier, true))
        }
    }
}

fn keys() -> Markup {
    let keys = [
        ("← →", "frame before and after"),
        ("Home End", "first and last frame"),
        ("n, N", "next worse and next better frame"),
        ("space", "play as a flip-book"),
        ("1 2 3 4 5", "A alone, swipe, side by side, blink, difference"),
        ("x", "swap A and B"),
        ("+ − 0 z", "larger, smaller, fit, one to one"),
        ("shift and arrows", "move the picture, on the picture"),
        ("e, E", "brighter and darker by half a stop"),
    ];
    html! { dl.keys { @for (key, what) in keys { dt { kbd { (key) } } dd { (what) } } } }
}
