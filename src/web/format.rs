//! Numbers and times as the pages show them.

use crate::{
    metrics::{Better, Metric, MetricInfo, Value},
    store::{GPU_TIME, Timestamp},
};
use maud::{Markup, html};
use std::str::FromStr as _;

/// What stands where there is no number.
pub const ABSENT: &str = "–";

/// What is known of a metric's id, also of one that an older version stored.
pub fn metric_info(id: &str) -> Option<&'static MetricInfo> {
    Metric::from_str(id).ok().map(Metric::info)
}

/// The unit of a metric or of GPU time.
pub fn unit(id: &str) -> &'static str {
    match metric_info(id) {
        Some(info) => info.unit,
        None if id == GPU_TIME => "ms",
        None => "",
    }
}

/// Whether `a` is the better of two values.
pub fn is_better(id: &str, a: Value, b: Value) -> bool {
    let lower = metric_info(id).is_none_or(|info| info.better == Better::Lower);
    if lower { a.0 < b.0 } else { a.0 > b.0 }
}

/// A column's title: id and unit.
pub fn title(id: &str) -> Markup {
    let name = if id == GPU_TIME {
        "GPU time".to_owned()
    } else {
        id.to_uppercase()
    };
    let unit = unit(id);
    html! { (name) @if !unit.is_empty() { " " span.unit { (unit) } } }
}

/// As many digits as the metric's noise leaves meaning: decibels two, similarities five, milliseconds three.
pub fn value(id: &str, value: Option<Value>) -> String {
    let Some(Value(x)) = value else {
        return ABSENT.to_owned();
    };
    if x.is_nan() {
        return "NaN".to_owned();
    }
    if x.is_infinite() {
        return if x > 0.0 { "∞" } else { "−∞" }.to_owned();
    }
    let text = match unit(id) {
        "dB" => format!("{x:.2}"),
        "ms" => format!("{x:.3}"),
        _ if x != 0.0 && x.abs() < 1e-3 => format!("{x:.3e}"),
        _ => format!("{x:.5}"),
    };
    match text.strip_prefix('-') {
        Some(digits) => format!("−{digits}"),
        None => text,
    }
}

/// Milliseconds.
pub fn ms(time_ms: Option<f64>) -> String {
    value(GPU_TIME, time_ms.map(Value))
}

/// Binary multiples of a byte.
pub fn bytes(n_bytes: i64) -> String {
    let mut size = n_bytes as f64;
    let mut units = ["bytes", "KiB", "MiB", "GiB"].into_iter();
    let mut unit = units.next().unwrap_or_default();
    while size >= 1024.0
        && let Some(larger) = units.next()
    {
        (size, unit) = (size / 1024.0, larger);
    }
    if unit == "bytes" {
        format!("{size} {unit}")
    } else {
        format!("{size:.1} {unit}")
    }
}

/// How long ago, in the largest unit that makes it at least one; the exact time on hover.
pub fn age(then: Timestamp, now: Timestamp) -> Markup {
    let seconds = now.since(then).as_secs();
    let text = match seconds {
        0..5 => "just now".to_owned(),
        5..60 => format!("{seconds} s ago"),
        60..3600 => format!("{} min ago", seconds / 60),
        3600..86_400 => format!("{} h ago", seconds / 3600),
        86_400..172_800 => "1 day ago".to_owned(),
        _ => format!("{} days ago", seconds / 86_400),
    };
    html! { time datetime=(then) title=(then) { (text) } }
}

/// The start of a hash or commit; the whole on hover.
pub fn short_hash(hash: &str) -> Markup {
    let short: String = hash.chars().take(10).collect();
    html! { span.hash title=(hash) { (short) } }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_carry_the_digits_that_mean_something() {
        for (id, x, text) in [
            ("psnr", 31.256, "31.26"),
            ("psnr", f64::INFINITY, "∞"),
            ("psnr", f64::NAN, "NaN"),
            ("snr", -3.5, "−3.50"),
            ("ssim", 0.987_654_3, "0.98765"),
            ("mse", 0.000_012_34, "1.234e-5"),
            ("mse", 0.0, "0.00000"),
            (GPU_TIME, 0.25, "0.250"),
        ] {
            assert_eq!(value(id, Some(Value(x))), text, "{id}");
        }
        assert_eq!(value("psnr", None), ABSENT);
        assert_eq!(bytes(512), "512 bytes");
        assert_eq!(bytes(3 << 20), "3.0 MiB");
    }

    #[test]
    fn better_depends_on_the_metric() {
        assert!(is_better("psnr", Value(f64::INFINITY), Value(40.0)));
        assert!(is_better("mse", Value(0.1), Value(0.2)));
        assert!(is_better(GPU_TIME, Value(0.1), Value(0.2)));
        assert!(!is_better("psnr", Value(f64::NAN), Value(1.0)));
    }

    #[test]
    fn ages_use_one_unit() {
        let now = Timestamp(10 * 86_400_000);
        for (ms, text) in [
            (1_000, "just now"),
            (59_000, "59 s ago"),
            (3_600_000, "1 h ago"),
            (259_200_000, "3 days ago"),
        ] {
            let markup = age(Timestamp(now.0 - ms), now).into_string();
            assert!(markup.contains(text), "{markup}");
        }
    }
}
