//! Tables on the screen.

use afterimage::{
    metrics::{Summary, Value},
    run::report::TimeSummary,
};
use comfy_table::{CellAlignment, Table, presets::NOTHING};
use std::collections::BTreeMap;

/// A table with `header`; all columns but the first `n_names` are numbers, flush right.
pub fn new(header: Vec<String>, n_names: usize) -> Table {
    let n_columns = header.len();
    let mut table = Table::new();
    table.load_style(NOTHING).set_header(header);
    for index in n_names..n_columns {
        if let Some(column) = table.column_mut(index) {
            column.set_cell_alignment(CellAlignment::Right);
        }
    }
    table
}

/// A metric's value: 4 significant decimals for ratios, 3 for decibels.
pub fn value(value: Value) -> String {
    match value.0 {
        v if v.is_nan() => "NaN".to_owned(),
        v if v.is_infinite() => if v > 0.0 { "∞" } else { "-∞" }.to_owned(),
        v if v.abs() >= 10.0 => format!("{v:.3}"),
        v if v.abs() >= 0.01 || v == 0.0 => format!("{v:.4}"),
        v => format!("{v:.2e}"),
    }
}

/// The mean of a metric's summary; a dash where it was not computed.
pub fn mean(summary: &BTreeMap<String, Summary>, metric: &str) -> String {
    summary
        .get(metric)
        .map_or_else(|| "–".to_owned(), |summary| value(summary.mean))
}

/// The sum of all passes' medians; a dash where the adapter has no timestamps.
pub fn gpu_ms(times: &BTreeMap<String, TimeSummary>) -> String {
    if times.is_empty() {
        return "–".to_owned();
    }
    format!("{:.3}", times.values().map(|time| time.median).sum::<f64>())
}
