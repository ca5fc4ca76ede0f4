//! Points as a table for other programs.

use super::Point;
use std::{collections::BTreeSet, fmt::Write};

/// A line a point: sequence, preset, what differs from it, times, metrics, passes, and the rest.
pub fn csv(points: &[&Point]) -> String {
    let quoted = |text: &str| format!("\"{}\"", text.replace('"', "\"\""));
    let names = |of: fn(&Point) -> Vec<&String>| {
        let all: BTreeSet<_> = points.iter().copied().flat_map(of).cloned().collect();
        all.into_iter().collect::<Vec<_>>()
    };
    let metrics = names(|point| point.metrics.keys().collect());
    let passes = names(|point| point.passes_ms.keys().collect());
    let mut text = "sequence,preset,parameters,median_ms,mad_ms,low_ms,high_ms".to_owned();
    for metric in &metrics {
        let _ = write!(text, ",{metric}");
    }
    for pass in &passes {
        let _ = write!(text, ",{pass}_ms");
    }
    text += ",bytes_per_pixel,over_copy,skipped,peak_gpu_bytes,dominated_by\n";
    for point in points {
        let parameters = serde_json::Value::Object(point.parameters.clone()).to_string();
        let time = &point.time_ms;
        let _ = write!(
            text,
            "{},{},{},{},{},{},{}",
            quoted(&point.sequence),
            point.preset,
            quoted(&parameters),
            time.median,
            time.mad,
            time.low,
            time.high
        );
        for metric in &metrics {
            let value = point.metrics.get(metric).map(|value| value.0.to_string());
            let _ = write!(text, ",{}", value.unwrap_or_default());
        }
        for pass in &passes {
            let ms = point.passes_ms.get(pass).map(f64::to_string);
            let _ = write!(text, ",{}", ms.unwrap_or_default());
        }
        let peak = point.peak_gpu_bytes.map(|bytes| bytes.to_string()).unwrap_or_default();
        let by = point.dominated_by.as_deref().map(quoted).unwrap_or_default();
        let over_copy = point.over_copy.map(|ratio| ratio.to_string()).unwrap_or_default();
        let (n_bytes, skipped) = (point.bytes_per_pixel, point.skipped);
        let _ = writeln!(text, ",{n_bytes},{over_copy},{skipped},{peak},{by}");
    }
    text
}
