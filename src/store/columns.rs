//! Frames and points packed into blobs. A frame in rows of its own costs SQLite a row a metric; packed, sixty frames are
//! one row, and every bit of a number comes back.
//!
//! A chunk of n frames is columns of n little-endian f64 each: frame index, flags (1 reset, 2 warm-up), repaired texels,
//! non-finite pixels, then one a metric and one a pass, in the order of the chunk's layout. Counts are exact to 2⁵³.

use super::{Timestamp, TrendPoint};
use crate::{metrics::Value, run::report::FrameReport};
use std::collections::{BTreeMap, BTreeSet};

/// Stands where a frame has no value; no arithmetic makes this NaN, and values that are NaN are stored as another.
const ABSENT: u64 = 0x7ff8_0000_0000_a85e;
const RESET: f64 = 1.0;
const WARMUP: f64 = 2.0;

/// The names of a chunk's columns.
#[derive(Clone, Debug, Default, PartialEq, Eq, Hash)]
pub(super) struct Layout {
    pub metrics: Vec<String>,
    pub passes: Vec<String>,
}

impl Layout {
    /// Whatever any of `frames` has.
    pub fn of(frames: &[FrameReport]) -> Self {
        let metrics: BTreeSet<&String> = frames.iter().flat_map(|frame| frame.metrics.keys()).collect();
        let passes: BTreeSet<&String> = frames.iter().flat_map(|frame| frame.times_ms.keys()).collect();
        Self {
            metrics: metrics.into_iter().cloned().collect(),
            passes: passes.into_iter().cloned().collect(),
        }
    }

    /// Packs `frames`, all of whose values have a column here.
    pub fn pack(&self, frames: &[FrameReport]) -> Vec<u8> {
        let n_columns = 4 + self.metrics.len() + self.passes.len();
        let mut data = Vec::with_capacity(8 * n_columns * frames.len());
        let mut column = |value: &dyn Fn(&FrameReport) -> Option<f64>| {
            for frame in frames {
                let bits = match value(frame) {
                    None => ABSENT,
                    Some(value) if value.is_nan() => f64::NAN.to_bits(),
                    Some(value) => value.to_bits(),
                };
                data.extend(bits.to_le_bytes());
            }
        };
        let flag = |set: bool, value: f64| if set { value } else { 0.0 };
        column(&|frame| Some(frame.index as f64));
        column(&|frame| Some(flag(frame.reset, RESET) + flag(frame.warmup, WARMUP)));
        column(&|frame| Some(frame.repaired_texels as f64));
        column(&|frame| Some(frame.non_finite_pixels as f64));
        for metric in &self.metrics {
            column(&|frame| frame.metrics.get(metric).map(|value| value.0));
        }
        for pass in &self.passes {
            column(&|frame| frame.times_ms.get(pass).copied());
        }
        data
    }

    /// Adds a chunk's frames to `frames`. `None` where the blob is not of this layout.
    pub fn unpack(&self, data: &[u8], frames: &mut BTreeMap<usize, FrameReport>) -> Option<()> {
        let n_columns = 4 + self.metrics.len() + self.passes.len();
        let (numbers, rest) = data.as_chunks::<8>();
        if !rest.is_empty() || numbers.len() % n_columns != 0 {
            return None;
        }
        let n_frames = numbers.len() / n_columns;
        let bits = |column: usize, row: usize| u64::from_le_bytes(numbers[column * n_frames + row]);
        let number = |column, row| f64::from_bits(bits(column, row));
        for row in 0..n_frames {
            let index = number(0, row) as usize;
            let frame = frames.entry(index).or_insert_with(|| FrameReport::empty(index));
            let flags = number(1, row) as u64;
            frame.reset |= flags & 1 != 0;
            frame.warmup |= flags & 2 != 0;
            frame.repaired_texels = number(2, row) as u64;
            frame.non_finite_pixels = number(3, row) as u64;
            let present = |column| (bits(column, row) != ABSENT).then(|| number(column, row));
            for (offset, metric) in self.metrics.iter().enumerate() {
                if let Some(value) = present(4 + offset) {
                    frame.metrics.insert(metric.clone(), Value(value));
                }
            }
            for (offset, pass) in self.passes.iter().enumerate() {
                if let Some(time_ms) = present(4 + self.metrics.len() + offset) {
                    frame.times_ms.insert(pass.clone(), time_ms);
                }
            }
        }
        Some(())
    }
}

/// Bytes of a packed point: report, branch, time, value, version.
const POINT_BYTES: usize = 36;

/// Packs a run of points.
pub(super) fn pack_points(points: &[TrendPoint]) -> Vec<u8> {
    let mut data = Vec::with_capacity(POINT_BYTES * points.len());
    for point in points {
        data.extend(point.report_id.to_le_bytes());
        data.extend(point.branch_id.to_le_bytes());
        data.extend(point.created_at.0.to_le_bytes());
        data.extend(point.value.0.to_le_bytes());
        data.extend(point.metric_version.to_le_bytes());
    }
    data
}

/// The inverse of [`pack_points`].
pub(super) fn unpack_points(data: &[u8], points: &mut Vec<TrendPoint>) {
    let (records, _) = data.as_chunks::<POINT_BYTES>();
    points.extend(records.iter().map(|record| {
        let word = |at: usize| -> [u8; 8] { std::array::from_fn(|i| record[at + i]) };
        TrendPoint {
            report_id: i64::from_le_bytes(word(0)),
            branch_id: i64::from_le_bytes(word(8)),
            created_at: Timestamp(i64::from_le_bytes(word(16))),
            value: Value(f64::from_le_bytes(word(24))),
            metric_version: u32::from_le_bytes(std::array::from_fn(|i| record[32 + i])),
        }
    }));
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frame(index: usize, psnr: Option<f64>) -> FrameReport {
        FrameReport {
            reset: index == 0,
            warmup: index < 2,
            repaired_texels: 1 << 40,
            non_finite_pixels: 7,
            metrics: psnr
                .map(|value| ("psnr".to_owned(), Value(value)))
                .into_iter()
                .collect(),
            times_ms: BTreeMap::from([(format!("pass{}", index % 2), 0.1 + index as f64)]),
            ..FrameReport::empty(index)
        }
    }

    #[test]
    fn every_bit_comes_back_and_what_is_absent_stays_so() {
        let frames = [
            frame(0, Some(f64::NAN)),
            frame(1, None),
            frame(2, Some(f64::NEG_INFINITY)),
            frame(3, Some(24.980_085_622_375_846)),
        ];
        let layout = Layout::of(&frames);
        assert_eq!(layout.passes, ["pass0", "pass1"]);
        let data = layout.pack(&frames);
        let mut read = BTreeMap::new();
        layout.unpack(&data, &mut read).unwrap();
        for (read, written) in read.values().zip(&frames) {
            assert_eq!(format!("{read:?}"), format!("{written:?}"));
        }
        assert!(
            layout.unpack(&data[8..], &mut BTreeMap::new()).is_none(),
            "a damaged blob"
        );
    }

    #[test]
    fn a_later_chunk_adds_to_an_earlier_one() {
        let mut read = BTreeMap::new();
        for frame in [
            frame(0, Some(1.0)),
            FrameReport {
                metrics: BTreeMap::from([("late".to_owned(), Value(9.0))]),
                ..FrameReport::empty(0)
            },
        ] {
            let layout = Layout::of(std::slice::from_ref(&frame));
            layout.unpack(&layout.pack(&[frame]), &mut read).unwrap();
        }
        assert_eq!(
            (read[&0].metrics["psnr"], read[&0].metrics["late"]),
            (Value(1.0), Value(9.0))
        );
        assert!(read[&0].reset);
    }
}
