//! Style sheet, scripts and pictures, embedded in the program.

use super::layout::PageError;
use crate::{
    hex::hex,
    image::{Extent, Image, files::png::encode_png},
    metrics::map::false_color,
};
use axum::{
    extract::Path,
    http::header,
    response::{IntoResponse, Response},
};
use sha2::{Digest as _, Sha256};
use std::{borrow::Cow, sync::LazyLock};

struct Asset {
    name: &'static str,
    media_type: &'static str,
    content: Cow<'static, [u8]>,
}

const JAVASCRIPT: &str = "text/javascript; charset=utf-8";
const CSS: &str = "text/css; charset=utf-8";

static ASSETS: LazyLock<Vec<Asset>> = LazyLock::new(|| {
    let embedded = |name, media_type, content: &'static [u8]| Asset {
        name,
        media_type,
        content: Cow::Borrowed(content),
    };
    vec![
        embedded("style.css", CSS, include_bytes!("assets/style.css")),
        embedded("api.js", JAVASCRIPT, include_bytes!("assets/api.js")),
        embedded("chart.js", JAVASCRIPT, include_bytes!("assets/chart.js")),
        embedded("format.js", JAVASCRIPT, include_bytes!("assets/format.js")),
        embedded("job.js", JAVASCRIPT, include_bytes!("assets/job.js")),
        embedded("jobs.js", JAVASCRIPT, include_bytes!("assets/jobs.js")),
        embedded("new_job.js", JAVASCRIPT, include_bytes!("assets/new_job.js")),
        embedded("page.js", JAVASCRIPT, include_bytes!("assets/page.js")),
        embedded("pixels.js", JAVASCRIPT, include_bytes!("assets/pixels.js")),
        embedded("progress.js", JAVASCRIPT, include_bytes!("assets/progress.js")),
        embedded("report.js", JAVASCRIPT, include_bytes!("assets/report.js")),
        embedded("screen_2d.js", JAVASCRIPT, include_bytes!("assets/screen_2d.js")),
        embedded("screen_gl.js", JAVASCRIPT, include_bytes!("assets/screen_gl.js")),
        embedded("sequence.js", JAVASCRIPT, include_bytes!("assets/sequence.js")),
        embedded("series.js", JAVASCRIPT, include_bytes!("assets/series.js")),
        embedded("stage.js", JAVASCRIPT, include_bytes!("assets/stage.js")),
        embedded("theme.js", JAVASCRIPT, include_bytes!("assets/theme.js")),
        embedded("trends.js", JAVASCRIPT, include_bytes!("assets/trends.js")),
        embedded("viewer.js", JAVASCRIPT, include_bytes!("assets/viewer.js")),
        embedded("icon.svg", "image/svg+xml", include_bytes!("assets/icon.svg")),
        // uPlot 1.6.32, MIT; the licence is served beside it.
        embedded("uplot.js", JAVASCRIPT, include_bytes!("assets/uplot.js")),
        embedded("uplot.css", CSS, include_bytes!("assets/uplot.css")),
        embedded(
            "uplot.LICENSE",
            "text/plain; charset=utf-8",
            include_bytes!("assets/uplot.LICENSE"),
        ),
        Asset {
            name: "scale.png",
            media_type: "image/png",
            content: Cow::Owned(error_scale()),
        },
    ]
});

/// Changes with any asset, so that browsers may keep each for ever.
static VERSION: LazyLock<String> = LazyLock::new(|| {
    let mut hash = Sha256::new();
    for asset in ASSETS.iter() {
        hash.update(&asset.content);
    }
    hex(&hash.finalize()[..6])
});

/// The colours of error images, from 0 to white.
fn error_scale() -> Vec<u8> {
    let extent = Extent::new(256, 1);
    encode_png(&false_color(&Image::from_fn(extent, |x, _| x as f32 / 255.0), 1.0), &[])
}

/// The address of an asset.
pub fn url(name: &str) -> String {
    format!("/assets/{}/{name}", *VERSION)
}

/// `GET /assets/{version}/{file}`
pub async fn serve(Path((_version, name)): Path<(String, String)>) -> Result<Response, PageError> {
    let asset = ASSETS
        .iter()
        .find(|asset| asset.name == name)
        .ok_or_else(|| PageError::nothing_at(&name))?;
    let headers = [
        (header::CONTENT_TYPE, asset.media_type),
        (header::CACHE_CONTROL, "public, max-age=31536000, immutable"),
    ];
    Ok((headers, asset.content.as_ref()).into_response())
}
