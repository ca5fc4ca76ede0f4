//! Images of single frames as PNG or EXR: a sequence's reference; a report's output, reference, error, and the map of any
//! spatial metric. PNG shows display values, by the sequence's own display transform; EXR holds linear RGB, and maps as
//! they were measured.

use super::{ApiError, ApiPath, ApiQuery, Service, Shared, reports};
use crate::{
    image::{
        Image,
        files::{
            exr::{FloatFormat, write_map_exr, write_rgb_exr},
            png::encode_png,
        },
    },
    metrics::{
        Display, Metric, Picture,
        map::{Map, NAN_COLOR, Scale, error_map, false_color},
    },
    sequence::{Channels, Sequence, frame::Rgb},
    store::Report,
};
use axum::{
    extract::State,
    http::{HeaderName, HeaderValue, StatusCode, header},
    response::{IntoResponse, Response},
};
use schemars::JsonSchema;
use serde::Deserialize;
use std::{
    fs,
    path::{Path, PathBuf},
    sync::Arc,
};

/// The error that is drawn white unless `?max=` says otherwise: a tenth of the display range.
pub const DEFAULT_MAX_ERROR: f32 = 0.1;

/// Tells a viewer of a false-colour image what white stands for.
const MAX_ERROR_HEADER: HeaderName = HeaderName::from_static("x-afterimage-error-max");

#[derive(Clone, Copy, PartialEq, Eq)]
enum Content {
    Output,
    Reference,
    Error,
    Map(Metric),
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Encoding {
    Png,
    Exr,
}

/// Splits `error.png` and the like.
fn parse(image: &str) -> Result<(Content, Encoding), ApiError> {
    let (name, extension) = image.rsplit_once('.').unwrap_or((image, ""));
    let content = match name {
        "output" => Some(Content::Output),
        "reference" => Some(Content::Reference),
        "error" => Some(Content::Error),
        metric => metric.parse().ok().map(Content::Map),
    };
    match (content, extension) {
        (Some(content), "png") => Ok((content, Encoding::Png)),
        (Some(content), "exr") => Ok((content, Encoding::Exr)),
        _ => Err(ApiError::not_found(format!(
            "there is no image `{image}`; there are output, reference, error and the map of each spatial metric, such as \
             `flip`, all as .png and .exr"
        ))),
    }
}

/// Query of a report's images.
#[derive(Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ImageQuery {
    /// The error, in display values, or the value of a map that is drawn white.
    max: Option<f32>,
}

/// `GET /sequences/{sequence}/frames/{frame}/reference.png`
pub async fn of_sequence(
    State(service): Shared,
    ApiPath((name, frame_index, image)): ApiPath<(String, usize, String)>,
) -> Result<Response, ApiError> {
    let (content, encoding) = parse(&image)?;
    if content != Content::Reference {
        return Err(ApiError::not_found(
            "of a sequence there is only `reference`; the others belong to reports",
        ));
    }
    let hash = super::sequences::find(&service, &name).await?.hash;
    blocking(move || {
        let source = Source::open(&service, &hash)?;
        let reference = source.reference(frame_index)?;
        Ok(encode_rgb(&service, &reference, source.display(), encoding)?.into_response())
    })
    .await
}

/// `GET /reports/{report}/frames/{frame}/{output|reference|error|METRIC}.{png|exr}`
pub async fn of_report(
    State(service): Shared,
    ApiPath((id, frame_index, image)): ApiPath<(i64, usize, String)>,
    ApiQuery(query): ApiQuery<ImageQuery>,
) -> Result<Response, ApiError> {
    let (content, encoding) = parse(&image)?;
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
        match content {
            Content::Reference => encode_rgb(&service, &source.reference(frame_index)?, display, encoding),
            Content::Output if encoding == Encoding::Exr => stored_output(&service, &report, frame_index),
            Content::Output => encode_rgb(&service, &output(&service, &report, frame_index)?, display, encoding),
            Content::Error => {
                let output = output(&service, &report, frame_index)?;
                let error = error_map(&source.reference(frame_index)?, &output, display).map_err(ApiError::internal)?;
                let max = query.max.unwrap_or(DEFAULT_MAX_ERROR);
                let mut response = match encoding {
                    Encoding::Png => respond(encode_png(&false_color(&error, max), &[]), encoding),
                    Encoding::Exr => respond(exr_of(&service, &error)?, encoding),
                };
                if let Ok(value) = HeaderValue::from_str(&max.to_string()) {
                    response.headers_mut().insert(MAX_ERROR_HEADER, value);
                }
                Ok(response)
            }
            Content::Map(metric) => {
                let output = output(&service, &report, frame_index)?;
                let reference = Picture::linear(source.reference(frame_index)?, display);
                let map = Map::new(metric, &reference, &Picture::linear(output, display));
                let map = map.map_err(|error| ApiError::not_found(error.to_string()))?;
                encode_map(&service, &map, query.max, encoding)
            }
        }
    })
    .await
}

/// Runs image work where it may block.
async fn blocking(work: impl FnOnce() -> Result<Response, ApiError> + Send + 'static) -> Result<Response, ApiError> {
    tokio::task::spawn_blocking(work).await.map_err(ApiError::internal)?
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

    fn reference(&self, frame_index: usize) -> Result<Image<Rgb>, ApiError> {
        let n_frames = self.0.n_frames();
        if frame_index >= n_frames {
            let detail = format!(
                "there is no frame {frame_index}; the sequence has 0 to {}",
                n_frames - 1
            );
            return Err(ApiError::not_found(detail));
        }
        let wanted = Channels {
            reference: true,
            ..Channels::default()
        };
        let frame = self.0.load(frame_index, wanted).map_err(ApiError::internal)?;
        frame
            .reference
            .ok_or_else(|| ApiError::not_found("the sequence has no reference"))
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

fn encode_rgb(
    service: &Service,
    image: &Image<Rgb>,
    display: Display,
    encoding: Encoding,
) -> Result<Response, ApiError> {
    let bytes = match encoding {
        Encoding::Png => encode_png(&image.map(|pixel| shown(display, pixel)), &[]),
        Encoding::Exr => exr_bytes(service, |path| write_rgb_exr(path, image, FloatFormat::Float))?,
    };
    Ok(respond(bytes, encoding))
}

/// The pixel on a screen; one that is not finite is drawn in a colour that no scene has by chance.
fn shown(display: Display, pixel: Rgb) -> [u8; 3] {
    let values = display.apply(pixel);
    if values.iter().any(|value| value.is_nan()) {
        return NAN_COLOR;
    }
    values.map(|value| (value * 255.0).round() as u8)
}

fn encode_map(service: &Service, map: &Map, max: Option<f32>, encoding: Encoding) -> Result<Response, ApiError> {
    if encoding == Encoding::Exr {
        return Ok(respond(exr_of(service, &map.values)?, encoding));
    }
    let default = map.scale();
    let scale = Scale {
        white: max.unwrap_or(default.white),
        ..default
    };
    Ok(respond(map.encode_png(scale), encoding))
}

fn exr_of(service: &Service, map: &Image<f32>) -> Result<Vec<u8>, ApiError> {
    exr_bytes(service, |path| write_map_exr(path, map))
}

/// The writer seeks in its file, so the bytes go by way of one.
fn exr_bytes<E: std::fmt::Display>(
    service: &Service,
    write: impl FnOnce(&Path) -> Result<(), E>,
) -> Result<Vec<u8>, ApiError> {
    let folder = tempfile::tempdir_in(service.folder.spool()).map_err(ApiError::internal)?;
    let path = folder.path().join("image.exr");
    write(&path).map_err(ApiError::internal)?;
    fs::read(&path).map_err(ApiError::internal)
}

/// Reports and contents never change, so neither do their images.
fn respond(bytes: Vec<u8>, encoding: Encoding) -> Response {
    let media_type = match encoding {
        Encoding::Png => "image/png",
        Encoding::Exr => "image/x-exr",
    };
    let headers = [
        (header::CONTENT_TYPE, media_type),
        (header::CACHE_CONTROL, "private, max-age=31536000, immutable"),
    ];
    (headers, bytes).into_response()
}
