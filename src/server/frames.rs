//! Images of single frames as PNG, EXR or bare halves: a sequence's input and reference; a report's output, error, and the
//! map of any spatial metric. PNG shows display values, by the sequence's own display transform; the others hold linear RGB,
//! and maps as they were measured.

use super::{
    ApiError, ApiPath, ApiQuery, Service, Shared, blocking,
    encoding::{Encoder, Encoding, respond},
    reports,
};
use crate::{
    image::Image,
    metrics::{
        Display, Metric, Picture,
        map::{Map, Scale, error_map},
    },
    run::Trace,
    sequence::{Channels, Sequence, frame::Rgb},
    store::Report,
    taa::TILE,
};
use axum::{
    extract::State,
    http::{HeaderValue, StatusCode, header},
    response::Response,
};
use schemars::JsonSchema;
use serde::Deserialize;
use std::{fs, path::PathBuf, sync::Arc};

/// The error that is drawn white unless `?max=` says otherwise: a tenth of the display range.
pub const DEFAULT_MAX_ERROR: f32 = 0.1;

/// The widest and the narrowest that a PNG can be asked for.
const WIDTHS: std::ops::RangeInclusive<u32> = 16..=4096;

#[derive(Clone, Copy, PartialEq, Eq)]
enum Content {
    Input,
    Output,
    Reference,
    Error,
    Trace(Trace),
    Map(Metric),
}

/// Splits `error.png` and the like.
fn parse(image: &str) -> Result<(Content, Encoding), ApiError> {
    let (name, extension) = image.rsplit_once('.').unwrap_or((image, ""));
    let content = match name {
        "input" => Some(Content::Input),
        "output" => Some(Content::Output),
        "reference" => Some(Content::Reference),
        "error" => Some(Content::Error),
        name => {
            let trace = Trace::ALL.into_iter().find(|trace| trace.id() == name);
            trace
                .map(Content::Trace)
                .or_else(|| name.parse().ok().map(Content::Map))
        }
    };
    match (content, Encoding::of_extension(extension)) {
        (Some(content), Some(encoding)) => Ok((content, encoding)),
        _ => Err(ApiError::not_found(format!(
            "there is no image `{image}`; there are input, output, reference, error, history, skipped and the map of each \
             spatial metric, such as `flip`, all as .png, .exr and .f16"
        ))),
    }
}

/// Query of a report's images.
#[derive(Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ImageQuery {
    /// The error, in display values, or the value of a map that is drawn white.
    max: Option<f32>,
    /// Make a PNG at most so wide, 16 to 4096 pixels.
    #[schemars(range(min = 16, max = 4096))]
    width: Option<u32>,
}

/// Query of a sequence's images.
#[derive(Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SequenceImageQuery {
    /// Make a PNG at most so wide, 16 to 4096 pixels.
    #[schemars(range(min = 16, max = 4096))]
    width: Option<u32>,
}

fn check_width(width: Option<u32>) -> Result<(), ApiError> {
    match width.is_none_or(|width| WIDTHS.contains(&width)) {
        true => Ok(()),
        false => Err(ApiError::new(StatusCode::BAD_REQUEST, "bad_query", "`width` must be 16 to 4096").field("width")),
    }
}

/// `GET /sequences/{sequence}/frames/{frame}/{input|reference}.{png|exr|f16}`
pub async fn of_sequence(
    State(service): Shared,
    ApiPath((name, frame_index, image)): ApiPath<(String, usize, String)>,
    ApiQuery(query): ApiQuery<SequenceImageQuery>,
) -> Result<Response, ApiError> {
    let (content, encoding) = parse(&image)?;
    check_width(query.width)?;
    if !matches!(content, Content::Input | Content::Reference) {
        return Err(ApiError::not_found(
            "of a sequence there are `input` and `reference`; the others belong to reports",
        ));
    }
    let hash = super::sequences::find(&service, &name).await?.hash;
    let is_for_ever = name == hash;
    let mut response = blocking(move || {
        let source = Source::open(&service, &hash)?;
        let encoder = Encoder {
            service: &service,
            encoding,
            width: query.width,
        };
        let image = match content {
            Content::Input => source.input(frame_index)?,
            _ => source.reference(frame_index)?,
        };
        encoder.rgb(&image, source.display())
    })
    .await??;
    if !is_for_ever {
        let ask_again = HeaderValue::from_static("private, no-cache");
        response.headers_mut().insert(header::CACHE_CONTROL, ask_again);
    }
    Ok(response)
}

/// `GET /reports/{report}/frames/{frame}/{input|output|reference|error|history|skipped|METRIC}.{png|exr|f16}`
pub async fn of_report(
    State(service): Shared,
    ApiPath((id, frame_index, image)): ApiPath<(i64, usize, String)>,
    ApiQuery(query): ApiQuery<ImageQuery>,
) -> Result<Response, ApiError> {
    let (content, encoding) = parse(&image)?;
    check_width(query.width)?;
    if query.max.is_some_and(|max| !(max > 0.0 && max.is_finite())) {
        return Err(ApiError::new(StatusCode::BAD_REQUEST, "bad_query", "`max` must be above 0").field("max"));
    }
    let report = reports::find(&service, id).await?;
    blocking(move || {
        let hash = report.series.sequence_hash.as_ref().ok_or_else(|| {
            ApiError::not_found(format!(
                "report {id} has no images: it was posted for a sequence known by name only"
            ))
        })?;
        let source = Source::open(&service, hash)?;
        let display = source.display();
        let encoder = Encoder {
            service: &service,
            encoding,
            width: query.width,
        };
        match content {
            Content::Input => encoder.rgb(&source.input(frame_index)?, display),
            Content::Reference => encoder.rgb(&source.reference(frame_index)?, display),
            Content::Output if encoding == Encoding::Exr => stored_output(&service, &report, frame_index),
            Content::Output => encoder.rgb(&output(&service, &report, frame_index)?, display),
            Content::Error => {
                let output = output(&service, &report, frame_index)?;
                let error = error_map(&source.reference(frame_index)?, &output, display).map_err(ApiError::internal)?;
                let white = query.max.unwrap_or(DEFAULT_MAX_ERROR);
                encoder.error(&error, Scale { black: 0.0, white })
            }
            Content::Trace(trace) => {
                let values = traced(&service, &report, frame_index, trace)?;
                let white = query.max.unwrap_or(1.0);
                encoder.error(&values, Scale { black: 0.0, white })
            }
            Content::Map(metric) => {
                let output = output(&service, &report, frame_index)?;
                let reference = Picture::linear(source.reference(frame_index)?, display);
                let map = Map::new(metric, &reference, &Picture::linear(output, display));
                let map = map.map_err(|error| ApiError::not_found(error.to_string()))?;
                encoder.map(&map, query.max)
            }
        }
    })
    .await?
}

/// A stored sequence, opened for single frames.
struct Source(Sequence);

impl Source {
    fn open(service: &Arc<Service>, hash: &str) -> Result<Self, ApiError> {
        let folder = service.folder.sequence(hash);
        Sequence::open(&folder, &service.reader)
            .map(Self)
            .map_err(ApiError::internal)
    }

    fn display(&self) -> Display {
        self.0.display()
    }

    /// The colour that the engine rendered, jittered if the sequence is.
    fn input(&self, frame_index: usize) -> Result<Image<Rgb>, ApiError> {
        self.check(frame_index)?;
        let frame = self.0.load(frame_index, Channels::default());
        Ok(frame.map_err(ApiError::internal)?.color)
    }

    fn reference(&self, frame_index: usize) -> Result<Image<Rgb>, ApiError> {
        self.check(frame_index)?;
        let reference = self.0.load_reference(frame_index).map_err(ApiError::internal)?;
        reference.ok_or_else(|| ApiError::not_found("the sequence has no reference"))
    }

    fn check(&self, frame_index: usize) -> Result<(), ApiError> {
        let n_frames = self.0.n_frames();
        if frame_index < n_frames {
            return Ok(());
        }
        Err(ApiError::not_found(format!(
            "there is no frame {frame_index}; the sequence has 0 to {}",
            n_frames - 1
        )))
    }
}

/// The file that the worker wrote.
fn output_file(service: &Service, report: &Report, frame_index: usize) -> Result<PathBuf, ApiError> {
    let path = report
        .job_id
        .map(|job_id| service.folder.output(job_id, report.preset_index as usize, frame_index));
    if let Some(path) = path.filter(|path| path.is_file()) {
        return Ok(path);
    }
    Err(ApiError::not_found(format!(
        "report {} has no image of frame {frame_index}: the frame did not run, the job said `images: none`, or only numbers were posted",
        report.id
    )))
}

fn stored_output(service: &Service, report: &Report, frame_index: usize) -> Result<Response, ApiError> {
    let bytes = fs::read(output_file(service, report, frame_index)?).map_err(ApiError::internal)?;
    Ok(respond(bytes, Encoding::Exr))
}

fn output(service: &Service, report: &Report, frame_index: usize) -> Result<Image<Rgb>, ApiError> {
    let path = output_file(service, report, frame_index)?;
    Ok(service.reader.read_rgb(&path).map_err(ApiError::internal)?.image)
}

/// How an image came about, of the image's size.
fn traced(service: &Service, report: &Report, frame_index: usize, trace: Trace) -> Result<Image<f32>, ApiError> {
    let output = output_file(service, report, frame_index)?;
    let path = trace_file(service, report, frame_index, trace).ok_or_else(|| {
        let why = match trace {
            Trace::HistoryShare => "its recipe blends no history by a weight",
            Trace::SkippedTiles => "its job or recipe skips none",
        };
        let (id, name) = (report.id, trace.id());
        ApiError::not_found(format!(
            "report {id} has no `{name}`: {why}, or its job kept no images of this kind"
        ))
    })?;
    let stored = service.reader.read_rgb(&path).map_err(ApiError::internal)?.image;
    match trace {
        Trace::HistoryShare => Ok(stored.map(|[share, ..]| share)),
        Trace::SkippedTiles => {
            let extent = service.reader.extent(&output, &["R".to_owned()]);
            let extent = extent.map_err(ApiError::internal)?;
            Ok(Image::from_fn(extent, |x, y| stored.at(x / TILE, y / TILE)[0]))
        }
    }
}

/// Where it lies, if it was kept.
pub fn trace_file(service: &Service, report: &Report, frame_index: usize, trace: Trace) -> Option<PathBuf> {
    let path = service
        .folder
        .trace(report.job_id?, report.preset_index as usize, frame_index, trace);
    path.is_file().then_some(path)
}
