//! The scorer's thread: waits for a submission, reads its images and times back, computes metrics, and gathers what
//! becomes the report.

use super::{
    Observer, RunError, Trace, Until,
    plan::Plan,
    report::{FrameReport, PresetReport, Report, SequenceInfo, Skipped, TimeSummary, note_of_broken, note_of_repaired},
    times::{summary, timed},
};
use crate::{
    gpu::{Gpu, Readback, Times},
    image::{Extent, Image},
    metrics::{
        FrameScores, LateValue, Metric, Picture, Reference, Summary, Track, Value,
        gpu::{DeviceTrack, Recorded},
        offset_px,
    },
    sequence::{Frame, Sequence, frame::Rgb},
    statistics::median,
    taa::{Kept, TILE},
};
use std::{
    collections::BTreeMap,
    sync::{
        Arc,
        mpsc::{Receiver, SyncSender},
    },
};

/// How far an output may lie beside its reference before the report says so, in pixels.
const OFFSET_LIMIT_PX: f64 = 0.05;

/// A frame that the GPU is working on.
pub struct Submitted {
    pub frame: Frame,
    /// Its reference, shared with the device's metrics.
    pub reference: Option<Arc<Image<Rgb>>>,
    /// Frames since the last reset.
    pub age: usize,
    pub submission: wgpu::SubmissionIndex,
    pub readback: Readback,
    pub times: Times,
    /// Read-back slot of each preset's shown image; none where nobody reads them.
    pub shown: Vec<usize>,
    /// Each preset's metrics where the adapter computes them.
    pub recorded: Vec<Recorded>,
    /// Read-back slot of each prepared colour's count of repaired texels.
    pub repaired: Vec<usize>,
    /// Each preset's tiles, where it may keep some.
    pub kept: Vec<Option<Kept>>,
    pub decode_ms: f64,
    pub upload_ms: f64,
    pub host_cpu_ms: f64,
}

/// A shown image on its way to the observer.
pub struct Shown {
    pub preset_index: usize,
    pub frame_index: usize,
    pub image: Arc<Image<Rgb>>,
    pub traces: Vec<(Trace, Image<f32>)>,
    /// What it is compared with, and itself as metrics see it.
    pub pictures: Option<[Picture; 2]>,
}

/// One preset's frames so far, and every time measured on its passes after warm-up.
struct Gathered {
    track: PresetTrack,
    frames: Vec<FrameReport>,
    pass_times_ms: BTreeMap<&'static str, Vec<f64>>,
    /// How often each tile was kept.
    n_kept: Vec<u32>,
    /// What to say of where the last output lies.
    offset: Option<String>,
}

/// Scores one preset's frames, wherever metrics are computed.
enum PresetTrack {
    Host(Box<Track>),
    Device(DeviceTrack),
}

pub struct Scorer<'a> {
    plan: &'a Plan,
    scores_on_host: bool,
    sequence: &'a Sequence,
    gpu: &'a Gpu,
    observer: &'a dyn Observer,
    /// Where images go, if anyone wants them.
    keep: Option<SyncSender<Shown>>,
    gathered: Vec<Gathered>,
    /// Of the previous frame.
    reference: Option<Reference>,
    stages_ms: BTreeMap<&'static str, f64>,
}

impl<'a> Scorer<'a> {
    pub fn new(
        plan: &'a Plan,
        on_device: bool,
        sequence: &'a Sequence,
        gpu: &'a Gpu,
        observer: &'a dyn Observer,
        keep: Option<SyncSender<Shown>>,
    ) -> Self {
        Self {
            plan,
            scores_on_host: !on_device && !plan.metrics.is_empty(),
            sequence,
            gpu,
            observer,
            keep,
            gathered: plan.systems.iter().map(|_| Gathered::new(plan, on_device)).collect(),
            reference: None,
            stages_ms: ["decode", "upload", "gpu", "readback", "metrics"]
                .map(|stage| (stage, 0.0))
                .into(),
        }
    }

    /// Scores frames until the channel closes or has given enough.
    pub fn score_all(mut self, submitted: &Receiver<Submitted>) -> Result<Self, RunError> {
        for mut submitted in submitted {
            self.gpu.wait(submitted.submission.clone())?;
            self.score(&mut submitted)?;
            if self.plan.until.is_some_and(|until| self.knows(until)) {
                break;
            }
        }
        // The writer ends with its channel.
        self.keep = None;
        Ok(self)
    }

    /// Whether every preset's frames say enough.
    fn knows(&self, until: Until) -> bool {
        self.gathered.iter().all(|gathered| {
            let counted = gathered.frames.iter().filter(|frame| !frame.warmup);
            let values = counted.filter_map(|frame| Some(frame.metrics.get(until.metric.id())?.0));
            until.is_met(&values.collect::<Vec<_>>())
        })
    }

    fn score(&mut self, submitted: &mut Submitted) -> Result<(), RunError> {
        let pass_ms = submitted.times.read(&submitted.readback)?;
        self.add("decode", submitted.decode_ms);
        self.add("upload", submitted.upload_ms);
        let n_resolving = pass_ms.len().min(self.plan.n_timed_passes() as usize);
        let (pass_ms, metric_pass_ms) = pass_ms.split_at(n_resolving);
        self.add("gpu", pass_ms.iter().sum());
        self.add("metrics", metric_pass_ms.iter().sum());
        let display = self.sequence.display();
        let picture = submitted
            .reference
            .take()
            .map(|linear| Picture::linear(linear, display));
        let (reference, reference_ms) = timed(|| {
            let picture = picture.clone().filter(|_| self.scores_on_host)?;
            let motion_px = submitted.frame.take_output_motion_px().map(Arc::new);
            Some(match &self.reference {
                Some(previous) if submitted.age > 0 => previous.follow(picture, motion_px.as_ref()),
                Some(previous) => previous.restart(picture),
                None => Reference::new(picture, &self.plan.metrics),
            })
        });
        self.add("metrics", reference_ms);
        let frame_index = submitted.frame.index;
        for index in 0..self.plan.systems.len() {
            let report = self.score_preset(submitted, index, reference.as_ref(), picture.as_ref(), pass_ms)?;
            self.gathered[index].frames.push(report);
            let n_systems = self.plan.systems.len();
            self.observer.progress(
                frame_index * n_systems + index + 1,
                self.plan.n_frames * n_systems + self.plan.n_validated,
            );
        }
        self.reference = reference.map(|mut reference| {
            reference.retire();
            reference
        });
        Ok(())
    }

    fn score_preset(
        &mut self,
        submitted: &Submitted,
        index: usize,
        reference: Option<&Reference>,
        truth: Option<&Picture>,
        pass_ms: &[f64],
    ) -> Result<FrameReport, RunError> {
        let frame = &submitted.frame;
        let (image, readback_ms) = timed(|| {
            let slot = submitted.shown.get(index)?;
            Some(submitted.readback.rgb(*slot, self.sequence.output_size()))
        });
        let image = image.transpose()?.map(Arc::new);
        let shown = image
            .as_ref()
            .map(|image| Picture::linear(Arc::clone(image), self.sequence.display()));
        let warmup = submitted.age < self.sequence.warmup_frames();
        let track = &mut self.gathered[index].track;
        let (scores, metrics_ms) = timed(|| match (track, reference, &shown) {
            (PresetTrack::Device(track), ..) => Ok(track.score(&submitted.recorded[index], &submitted.readback)?),
            (PresetTrack::Host(track), Some(reference), Some(shown)) => track
                .score(reference, shown, !warmup)
                .map_err(|error| RunError::Input(error.to_string())),
            (PresetTrack::Host(_), ..) => Ok(FrameScores {
                values: BTreeMap::new(),
                non_finite_pixels: count_non_finite(image.as_ref().expect("read back for the host")),
            }),
        });
        let scores = scores?;
        if let (Some(truth), Some(shown)) = (truth, &shown)
            && frame.index + 1 == self.plan.n_frames
        {
            self.gathered[index].offset = offset_note(truth, shown);
        }
        let kept = self.kept_tiles(submitted, index)?;
        self.add("readback", readback_ms);
        self.add("metrics", metrics_ms);
        if let (Some(keep), Some(image)) = (&self.keep, image) {
            let kept = Shown {
                preset_index: index,
                frame_index: frame.index,
                image,
                traces: self.traces(submitted, index, kept)?,
                pictures: truth.cloned().zip(shown).map(<[Picture; 2]>::from),
            };
            keep.send(kept)
                .map_err(|_| RunError::Internal("the writer stopped".to_owned()))?;
        }
        let mut times_ms = self.gather_times(index, pass_ms, warmup);
        times_ms.extend(
            [
                ("decode", submitted.decode_ms),
                ("upload", submitted.upload_ms),
                ("host_cpu", submitted.host_cpu_ms),
                ("readback", readback_ms),
                ("metrics", metrics_ms),
            ]
            .map(|(stage, ms)| (stage.to_owned(), ms)),
        );
        Ok(FrameReport {
            index: frame.index,
            reset: frame.reset,
            warmup,
            repaired_texels: self.repaired_texels(submitted, index)?,
            non_finite_pixels: scores.non_finite_pixels,
            metrics: scores
                .values
                .into_iter()
                .map(|(id, value)| (id.to_owned(), value))
                .collect(),
            times_ms,
        })
    }

    /// Which tiles of the frame were kept, if any may be; counts them.
    fn kept_tiles(&mut self, submitted: &Submitted, index: usize) -> Result<Option<Vec<bool>>, RunError> {
        let Some(kept) = &submitted.kept[index] else {
            return Ok(None);
        };
        let kept = kept.read(&submitted.readback, tiles(self.sequence.output_size()).width as usize)?;
        let n_kept = &mut self.gathered[index].n_kept;
        n_kept.resize(kept.len(), 0);
        n_kept
            .iter_mut()
            .zip(&kept)
            .for_each(|(n, &kept)| *n += u32::from(kept));
        Ok(Some(kept))
    }

    /// How the shown image came about, as far as the recipe can tell.
    fn traces(
        &self,
        submitted: &Submitted,
        index: usize,
        kept: Option<Vec<bool>>,
    ) -> Result<Vec<(Trace, Image<f32>)>, RunError> {
        let output = self.sequence.output_size();
        let mut traces = Vec::new();
        if self.plan.systems[index].recipe.blends_history() {
            let share = submitted.readback.alpha(submitted.shown[index], output)?;
            traces.push((Trace::HistoryShare, share));
        }
        if let Some(kept) = kept {
            let skipped = kept.into_iter().map(|kept| f32::from(u8::from(kept))).collect();
            traces.push((Trace::SkippedTiles, Image::from_pixels(tiles(output), skipped)));
        }
        Ok(traces)
    }

    /// Pass times come in the order recorded: the merging of samples, each prepared colour, then each preset's passes, `repeat` times each. Returns
    /// the medians of this preset's passes.
    fn gather_times(&mut self, index: usize, pass_ms: &[f64], warmup: bool) -> BTreeMap<String, f64> {
        let system = &self.plan.systems[index];
        let recipe = &system.recipe;
        let prepared = self.plan.prepared.iter().position(|&key| key == recipe.preparation());
        let before: usize = self.plan.systems[..index]
            .iter()
            .map(|system| system.passes.len())
            .sum();
        let n_merges = self.plan.n_merges();
        let prepared = n_merges + prepared.expect("planned for this recipe");
        let first = n_merges + self.plan.prepared.len() + before;
        let passes = (0..n_merges)
            .map(|position| ("merge", position))
            .chain([("prepare", prepared)])
            .chain(system.passes.iter().copied().zip(first..));
        let mut medians = BTreeMap::new();
        for (pass, position) in passes {
            // None where the adapter has no timestamps.
            let Some(measured) = pass_ms.chunks_exact(self.plan.repeat as usize).nth(position) else {
                continue;
            };
            medians.insert(pass.to_owned(), median(measured));
            if !warmup {
                self.gathered[index]
                    .pass_times_ms
                    .entry(pass)
                    .or_default()
                    .extend(measured);
            }
        }
        medians
    }

    fn repaired_texels(&self, submitted: &Submitted, index: usize) -> Result<u64, RunError> {
        let recipe = &self.plan.systems[index].recipe;
        let keys = self.plan.prepared.iter().zip(&submitted.repaired);
        let (_, &slot) = keys
            .into_iter()
            .find(|(key, _)| **key == recipe.preparation())
            .expect("planned for this recipe");
        let bytes = submitted.readback.bytes(slot)?;
        Ok(u64::from(u32::from_le_bytes(std::array::from_fn(|i| bytes[i]))))
    }

    fn add(&mut self, stage: &'static str, ms: f64) {
        *self.stages_ms.entry(stage).or_default() += ms;
    }

    /// The report of everything scored.
    pub fn into_report(mut self, hash: String, n_decoders: usize, output_ms: f64, total_ms: f64) -> Report {
        self.stages_ms.entry("decode").and_modify(|ms| *ms /= n_decoders as f64);
        self.stages_ms.insert("output", output_ms);
        self.stages_ms.insert("total", total_ms);
        let (plan, sequence) = (self.plan, self.sequence);
        let n_frames = self.gathered.first().map_or(0, |gathered| gathered.frames.len());
        let ended = plan.until.filter(|_| n_frames < plan.n_frames);
        let ended = ended.map(|until| format!("ended after {n_frames} of {} frames, at {until}", plan.n_frames));
        Report {
            sequence: SequenceInfo {
                name: sequence.name().to_owned(),
                hash,
                render_size: sequence.render_size(),
                output_size: sequence.output_size(),
                n_frames,
            },
            adapter: self.gpu.info(),
            revision: env!("AFTERIMAGE_REVISION").to_owned(),
            metric_versions: plan
                .metrics
                .iter()
                .map(|metric| (metric.id().to_owned(), metric.info().version))
                .collect(),
            stages_ms: self
                .stages_ms
                .into_iter()
                .map(|(stage, ms)| (stage.to_owned(), ms))
                .collect(),
            reports: plan
                .systems
                .iter()
                .zip(self.gathered)
                .map(|(system, gathered)| {
                    let times_ms = gathered.pass_times_ms.iter();
                    let times_ms = times_ms
                        .filter_map(|(pass, ms)| Some(((*pass).to_owned(), summary(ms)?)))
                        .collect();
                    let times_ms: BTreeMap<_, TimeSummary> = times_ms;
                    let skipped = gathered.skipped(sequence.output_size(), &times_ms);
                    let saved = skipped.as_ref().map(Skipped::note);
                    let offset = gathered.offset.clone();
                    let frames = gathered.finish();
                    let notes = system
                        .notes
                        .iter()
                        .chain(&offset)
                        .chain(&saved)
                        .chain(&ended)
                        .cloned()
                        .chain(note_of_repaired(&frames))
                        .chain(note_of_broken(&frames))
                        .collect();
                    PresetReport {
                        preset: system.preset.clone(),
                        parameters: system.recipe.to_json(),
                        notes,
                        summary: summaries(&plan.metrics, &frames),
                        times_ms,
                        validation: None,
                        skipped,
                        frames,
                    }
                })
                .collect(),
        }
    }
}

impl Gathered {
    fn new(plan: &Plan, on_device: bool) -> Self {
        Self {
            track: match on_device {
                true => PresetTrack::Device(DeviceTrack::new(&plan.metrics)),
                false => PresetTrack::Host(Box::new(Track::new(&plan.metrics))),
            },
            frames: Vec::new(),
            pass_times_ms: BTreeMap::new(),
            n_kept: Vec::new(),
            offset: None,
        }
    }

    /// What was left out, and what that saved: a pass over listed tiles takes time for each.
    fn skipped(&self, output: Extent, times_ms: &BTreeMap<String, TimeSummary>) -> Option<Skipped> {
        let n_frames = self.frames.len() as f64;
        let kept: Vec<_> = self.n_kept.iter().map(|&n| (f64::from(n) / n_frames) as f32).collect();
        let share = kept.iter().map(|&kept| f64::from(kept)).sum::<f64>() / kept.len() as f64;
        let listed_ms: f64 = times_ms
            .iter()
            .filter(|(pass, _)| ["edges", "resolve", "sharpen", "stabilise"].contains(&pass.as_str()))
            .map(|(_, time)| time.median)
            .sum();
        let total_ms: f64 = times_ms.values().map(|time| time.median).sum();
        let saved_ms = (share < 1.0).then(|| listed_ms * share / (1.0 - share));
        (!kept.is_empty()).then_some(Skipped {
            share,
            saved_ms,
            without_ms: saved_ms.map(|saved| total_ms + saved),
            tiles: tiles(output),
            kept,
        })
    }

    /// Every frame with all its values.
    fn finish(self) -> Vec<FrameReport> {
        let mut frames = self.frames;
        let late = match self.track {
            PresetTrack::Host(track) => track.finish(),
            PresetTrack::Device(track) => track.finish(),
        };
        for LateValue { frame, id, value } in late {
            frames[frame].metrics.insert(id.to_owned(), value);
        }
        frames
    }
}

/// Columns and rows of tiles.
fn tiles(extent: Extent) -> Extent {
    Extent::new(extent.width.div_ceil(TILE), extent.height.div_ceil(TILE))
}

/// Where the output does not lie on its reference.
pub fn offset_note(reference: &Picture, shown: &Picture) -> Option<String> {
    let [x, y] = offset_px(reference, shown)?;
    (x.hypot(y) > OFFSET_LIMIT_PX).then(|| {
        let (right, below) = (
            if x < 0.0 { "left" } else { "right" },
            if y < 0.0 { "above" } else { "below" },
        );
        format!(
            "the last output lies {:.2} px to the {right} of its reference and {:.2} px {below} it",
            x.abs(),
            y.abs()
        )
    })
}

fn count_non_finite(image: &Image<Rgb>) -> u64 {
    let is_bad = |pixel: &&Rgb| !pixel.iter().all(|channel| channel.is_finite());
    image.pixels().iter().filter(is_bad).count() as u64
}

/// Of every metric that has a value in a frame that counts.
pub fn summaries(metrics: &[Metric], frames: &[FrameReport]) -> BTreeMap<String, Summary> {
    let value = |frame: &FrameReport, metric: &Metric| frame.metrics.get(metric.id()).copied();
    metrics
        .iter()
        .filter_map(|metric| {
            let counted = frames.iter().filter(|frame| !frame.warmup || metric.is_late());
            let values = counted.filter_map(|frame| value(frame, metric)).collect::<Vec<Value>>();
            (!values.is_empty()).then(|| (metric.id().to_owned(), Summary::new(*metric, values)))
        })
        .collect()
}
