//! Times, traffic and memory of every setting. The frames of the sequence are played as often as needed; on each, the
//! settings take turns in a new random order, one submission each, so that whatever drifts (clocks, caches, the machine's
//! other work) falls on all alike. First one setting runs beside itself: what that differs by is noise.

use super::{
    BenchError, BenchSpec,
    clock::{Clock, Cost, cost, time_again},
    copy::Copy,
    sweep::Setting,
};
use crate::{
    gpu::{Dispatch, Gpu, GpuError, Timer, Variant},
    random::Random,
    run::{Observer, RunError, process_cpu_ms},
    sequence::{Channels, Frame, Sequence},
    statistics::median,
    taa::{EDGES_PASS, Inputs, Preparation, Recorder, Repeat, Resolver, SETTLE_PASS, Skip, Step, Watch},
};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, BTreeSet};

/// What the same setting measured twice differs by. No two times nearer than that are called different.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct Noise {
    /// The most that the paired ratio of both measurements may be from 1, with 95 % confidence.
    pub relative: f64,
    /// 95 % interval of the median ratio.
    pub ratio: [f64; 2],
    /// Which setting.
    pub setting: String,
    /// How many frames each.
    pub n_frames: usize,
}

/// One setting's.
pub struct Measured {
    pub frames_ms: Vec<f64>,
    pub upload_ms: f64,
    pub passes_ms: BTreeMap<String, f64>,
    pub n_bytes: f64,
    pub skipped: f64,
    pub peak_gpu_bytes: Option<u64>,
}

/// How many settings hold their histories on the device at once.
const MAX_TOGETHER: usize = 12;
/// Repeats an order of turns: a figure that surprises can be measured again as it was.
const SEED: u64 = 0x5eed;

pub fn measure(
    spec: &BenchSpec,
    settings: &[Setting],
    sequence: &Sequence,
    copy: &mut Copy<'_>,
    observer: &dyn Observer,
) -> Result<(Noise, Vec<Measured>), BenchError> {
    let mut random = Random::new(SEED);
    let n_rounds = 2 + settings.len().div_ceil(MAX_TOGETHER);
    observer.progress(0, n_rounds);
    let mut bench = Bench {
        spec,
        sequence,
        gpu: copy.gpu,
        copy,
        observer,
        random: &mut random,
    };
    let twice = bench.play(&[&settings[0], &settings[0]])?;
    let noise = Noise::between(&settings[0], &twice);
    observer.progress(1, n_rounds);
    let mut measured = Vec::with_capacity(settings.len());
    for (round, together) in settings.chunks(MAX_TOGETHER).enumerate() {
        measured.extend(bench.play(&together.iter().collect::<Vec<_>>())?);
        observer.progress(round + 2, n_rounds);
    }
    for (setting, measured) in settings.iter().zip(&mut measured) {
        measured.peak_gpu_bytes = bench.peak_bytes(setting)?;
    }
    observer.progress(n_rounds, n_rounds);
    Ok((noise, measured))
}

impl Noise {
    fn between(setting: &Setting, twice: &[Measured]) -> Self {
        let pairs = twice[0].frames_ms.iter().zip(&twice[1].frames_ms);
        let ratios: Vec<_> = pairs.map(|(a, b)| a / b).collect();
        let ratio = super::statistics::median_interval(&ratios);
        Self {
            relative: ratio.into_iter().map(|end| (end - 1.0).abs()).fold(0.0, f64::max),
            ratio,
            setting: Setting::name(&setting.preset, &setting.parameters),
            n_frames: ratios.len(),
        }
    }
}

struct Bench<'a, 'b> {
    spec: &'a BenchSpec,
    sequence: &'a Sequence,
    gpu: &'a Gpu,
    copy: &'a mut Copy<'b>,
    observer: &'a dyn Observer,
    random: &'a mut Random,
}

/// A setting in the middle of its measurement.
struct Lane<'a> {
    setting: &'a Setting,
    resolver: Resolver,
    timer: Timer,
    passes: Vec<&'static str>,
    frames_ms: Vec<f64>,
    uploads_ms: Vec<f64>,
    passes_ms: BTreeMap<&'static str, Vec<f64>>,
    n_bytes: Vec<f64>,
    skipped: Vec<f64>,
}

/// A frame on the device, for the settings that skip and for those that do not: uploading and preparing differ.
struct Side {
    skip: Skip,
    inputs: Inputs,
    preparations: BTreeSet<Preparation>,
    n_merges: usize,
    timer: Timer,
}

/// What a side's frame cost.
struct Prepared {
    upload_ms: f64,
    colors: BTreeMap<Preparation, (Share, f64)>,
}

/// The passes of a frame, and what they must move at the least: every image and buffer they bind, once, and twice what they
/// read and write. Bytes.
#[derive(Debug, Default)]
struct Traffic {
    steps: Vec<Step>,
    /// Of passes over every pixel.
    whole: u64,
    /// Of passes over listed tiles, if all were.
    listed: u64,
    /// Of the pass over those that are looked at afterwards, if all were.
    settled: u64,
    /// Of the pass over those whose images changed, if all did.
    changed: u64,
}

impl Traffic {
    fn recorder<'a>(
        &'a mut self,
        gpu: &'a Gpu,
        encoder: &'a mut wgpu::CommandEncoder,
        timer: &'a mut Timer,
    ) -> Recorder<'a> {
        Recorder {
            gpu,
            encoder,
            timer,
            repeat: Repeat::Timed(1),
            watch: Some(self),
        }
    }

    /// Milliseconds of each of `passes`, in which those stand that were recorded: 0 of one that had nothing to do.
    fn passes_ms(
        &self,
        gpu: &Gpu,
        timer: &mut Timer,
        cost: &Cost,
        passes: impl Iterator<Item = &'static str>,
    ) -> Result<Vec<(&'static str, f64)>, GpuError> {
        match Clock::of(gpu) {
            Clock::GpuTimestamps => Ok(passes.zip(cost.passes_ms.iter().copied()).collect()),
            Clock::ProcessCpu => {
                let times_ms = time_again(gpu, timer, &self.steps)?;
                // None where the adapter has no timestamps.
                if times_ms.len() < self.steps.len() {
                    return Ok(Vec::new());
                }
                let mut recorded = self.steps.iter().map(Step::label).zip(times_ms).peekable();
                let mut ms_of = |pass| recorded.next_if(|(label, _)| *label == pass).map_or(0.0, |(_, ms)| ms);
                Ok(passes.map(|pass| (pass, ms_of(pass))).collect())
            }
        }
    }
}

impl Watch for Traffic {
    fn recorded(
        &mut self,
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        dispatch: &Dispatch<'_>,
        counters: &[&wgpu::Buffer],
    ) -> Result<(), GpuError> {
        let n_bytes = dispatch.n_bytes();
        match (dispatch.label(), dispatch.is_indirect()) {
            (SETTLE_PASS, _) => self.settled += n_bytes,
            (EDGES_PASS, true) => self.changed += n_bytes,
            (_, true) => self.listed += n_bytes,
            (_, false) => self.whole += n_bytes,
        }
        self.steps.recorded(gpu, encoder, dispatch, counters)
    }
}

/// A frame of one setting.
struct Resolved {
    ms: f64,
    passes_ms: Vec<(&'static str, f64)>,
    n_bytes: f64,
    skipped: f64,
}

/// One colour's part in preparing them all.
struct Share {
    ms: f64,
    passes_ms: Vec<(&'static str, f64)>,
}

impl Bench<'_, '_> {
    /// Plays the sequence until every setting has its timed frames.
    fn play(&mut self, settings: &[&Setting]) -> Result<Vec<Measured>, BenchError> {
        let mut sides = self.sides(settings)?;
        let mut lanes = settings
            .iter()
            .map(|setting| Lane::new(self, setting))
            .collect::<Result<Vec<_>, _>>()?;
        for side in &sides {
            let lanes = lanes.iter_mut().filter(|lane| lane.setting.options.skip == side.skip);
            self.warm_up(&side.inputs, lanes)?;
        }
        let n_frames = self.spec.n_frames.unwrap_or(usize::MAX).min(self.sequence.n_frames());
        // A sequence that is all warm-up is timed from its last frame on.
        let warmup = self.sequence.warmup_frames().min(n_frames - 1);
        let (mut n_timed, mut age) = (0, 0);
        for position in 0.. {
            if self.observer.cancelled() {
                return Err(RunError::Cancelled.into());
            }
            let index = position % n_frames;
            if index == 0 && n_timed >= self.spec.n_timed {
                break;
            }
            let frame = self.frame(index, settings)?;
            age = if index == 0 || frame.reset { 0 } else { age + 1 };
            n_timed += usize::from(age >= warmup);
            self.copy.wake()?;
            let prepared = sides
                .iter_mut()
                .map(|side| side.prepare(self.gpu, &frame))
                .collect::<Result<Vec<_>, _>>()?;
            let mut order: Vec<_> = (0..lanes.len()).collect();
            self.random.shuffle(&mut order);
            for index in order {
                let lane = &mut lanes[index];
                let side = sides.iter().position(|side| side.skip == lane.setting.options.skip);
                let side = side.expect("a side for every setting");
                let cost = lane.run(self.gpu, &sides[side].inputs)?;
                if age >= warmup {
                    lane.add(cost, &prepared[side]);
                }
            }
        }
        Ok(lanes.into_iter().map(Lane::finish).collect())
    }

    fn sides(&self, settings: &[&Setting]) -> Result<Vec<Side>, GpuError> {
        let side = |skip: Skip| {
            let settings: Vec<_> = settings
                .iter()
                .copied()
                .filter(|setting| setting.options.skip == skip)
                .collect();
            let preparations: BTreeSet<_> = settings.iter().map(|setting| setting.recipe.preparation()).collect();
            let n_merges = usize::from(self.sequence.available().several.is_some());
            let n_timed = (n_merges + preparations.len()) as u32;
            (!preparations.is_empty()).then(|| {
                Ok(Side {
                    skip,
                    inputs: self.inputs(&settings)?,
                    preparations,
                    timer: Timer::new(self.gpu, n_timed),
                    n_merges,
                })
            })
        };
        [Skip::Off, Skip::Exact].into_iter().filter_map(side).collect()
    }

    fn frame(&self, index: usize, settings: &[&Setting]) -> Result<Frame, BenchError> {
        let frame = self.sequence.load(index, self.channels(settings));
        frame.map_err(|error| RunError::from(error).into())
    }

    fn channels(&self, settings: &[&Setting]) -> Channels {
        let available = self.sequence.available();
        settings
            .iter()
            .fold(Channels::default(), |all, setting| {
                let optional = setting.recipe.optional_channels().intersection(available);
                all.union(setting.recipe.required_channels()).union(optional)
            })
            .union(Channels {
                several: available.several,
                ..Channels::default()
            })
    }

    fn inputs(&self, settings: &[&Setting]) -> Result<Inputs, GpuError> {
        let wanted = settings.iter().map(|setting| setting.recipe.preparation()).collect();
        let skipping = settings.iter().filter(|setting| setting.options.skip != Skip::Off);
        let reach_px = skipping.map(|setting| setting.recipe.reach_px()).max();
        let (sizes, channels) = (self.sequence.sizes(), self.channels(settings));
        Inputs::tracking(self.gpu, sizes, channels, &wanted, reach_px, None)
    }

    /// Compiles every pass, so that no frame waits for it.
    fn warm_up<'s: 'l, 'l>(
        &self,
        inputs: &Inputs,
        lanes: impl Iterator<Item = &'l mut Lane<'s>>,
    ) -> Result<(), GpuError> {
        let mut encoder = self.gpu.device.create_command_encoder(&Default::default());
        let mut untimed = Timer::new(self.gpu, 0);
        inputs.prepare(self.gpu, &mut encoder, &mut untimed, Repeat::WarmUp)?;
        for lane in lanes {
            lane.resolver
                .resolve(self.gpu, &mut encoder, inputs, &mut untimed, Repeat::WarmUp)?;
        }
        self.gpu.wait(self.gpu.queue.submit([encoder.finish()]))
    }

    /// The device's memory while `setting` runs alone.
    fn peak_bytes(&self, setting: &Setting) -> Result<Option<u64>, BenchError> {
        let Some(before) = self.gpu.allocated_bytes() else {
            return Ok(None);
        };
        let mut inputs = self.inputs(&[setting])?;
        let mut lane = Lane::new(self, setting)?;
        let frame = self.frame(0, &[setting])?;
        inputs.upload(self.gpu, &frame)?;
        self.warm_up(&inputs, [&mut lane].into_iter())?;
        Ok(self.gpu.allocated_bytes().map(|now| now.saturating_sub(before)))
    }
}

impl Side {
    /// Brings a frame to the device and prepares its colours, one submission for all; each has its share of the cost, because
    /// the passes are alike.
    fn prepare(&mut self, gpu: &Gpu, frame: &Frame) -> Result<Prepared, GpuError> {
        let before = process_cpu_ms();
        self.inputs.upload(gpu, frame)?;
        let upload_ms = process_cpu_ms() - before;
        let mut traffic = Traffic::default();
        let (cost, ()) = cost(gpu, &mut self.timer, |encoder, timer, _| {
            self.inputs.record(&mut traffic.recorder(gpu, encoder, timer))
        })?;
        // Merging several samples comes first, once for all colours.
        let merge = (self.n_merges > 0).then_some("merge");
        let prepare = self.preparations.iter().map(|_| "prepare");
        let passes_ms = traffic.passes_ms(gpu, &mut self.timer, &cost, merge.into_iter().chain(prepare))?;
        let n = self.preparations.len();
        let n_bytes = (traffic.whole as f64 + self.inputs.changed_share() * traffic.listed as f64) / n as f64;
        let share = |(index, &key): (usize, &Preparation)| {
            let (merges, prepares) = passes_ms.split_at(passes_ms.len().min(self.n_merges));
            let passes_ms = merges.iter().chain(prepares.get(index)).copied().collect();
            let ms = cost.ms / n as f64;
            (key, (Share { ms, passes_ms }, n_bytes))
        };
        Ok(Prepared {
            upload_ms,
            colors: self.preparations.iter().enumerate().map(share).collect(),
        })
    }
}

impl<'a> Lane<'a> {
    fn new(bench: &Bench<'_, '_>, setting: &'a Setting) -> Result<Self, GpuError> {
        let sizes = bench.sequence.sizes();
        let gpu = bench.gpu.with(Variant {
            workgroup: setting.workgroup,
            workgroup_memory: setting.workgroup_memory,
            cache: None,
        });
        let passes = setting.recipe.passes_skipping(setting.options.skip, sizes);
        Ok(Self {
            resolver: Resolver::new(&gpu, setting.recipe.clone(), setting.options, sizes)?,
            timer: Timer::new(&gpu, passes.len() as u32),
            frames_ms: Vec::new(),
            uploads_ms: Vec::new(),
            passes_ms: BTreeMap::new(),
            n_bytes: Vec::new(),
            skipped: Vec::new(),
            passes,
            setting,
        })
    }

    /// Resolves the frame in `inputs`; what it cost, what it must move, and which share of its tiles it kept.
    fn run(&mut self, gpu: &Gpu, inputs: &Inputs) -> Result<Resolved, GpuError> {
        let mut traffic = Traffic::default();
        let resolver = &mut self.resolver;
        let (cost, shares) = cost(gpu, &mut self.timer, |encoder, timer, readback| {
            resolver.record(&mut traffic.recorder(gpu, encoder, timer), inputs)?;
            Ok(resolver.copy_shares(gpu, encoder, readback))
        })?;
        let (skipped, settled) = match shares {
            Some(shares) => (shares.kept(&cost.readback)?, shares.settled(&cost.readback)?),
            None => (0.0, 0.0),
        };
        let parts = [
            (1.0, traffic.whole),
            (1.0 - skipped, traffic.listed),
            (settled, traffic.settled),
            (inputs.changed_share(), traffic.changed),
        ];
        Ok(Resolved {
            ms: cost.ms,
            passes_ms: traffic.passes_ms(gpu, &mut self.timer, &cost, self.passes.iter().copied())?,
            n_bytes: parts.iter().map(|&(share, n_bytes)| share * n_bytes as f64).sum(),
            skipped,
        })
    }

    fn add(&mut self, resolved: Resolved, prepared: &Prepared) {
        let (prepare, prepare_bytes) = &prepared.colors[&self.setting.recipe.preparation()];
        self.frames_ms.push(prepare.ms + resolved.ms);
        self.uploads_ms.push(prepared.upload_ms);
        self.n_bytes.push(prepare_bytes + resolved.n_bytes);
        self.skipped.push(resolved.skipped);
        for (pass, ms) in prepare.passes_ms.iter().copied().chain(resolved.passes_ms) {
            self.passes_ms.entry(pass).or_default().push(ms);
        }
    }

    fn finish(self) -> Measured {
        let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len() as f64;
        Measured {
            passes_ms: self
                .passes_ms
                .iter()
                .map(|(&pass, ms)| (pass.to_owned(), median(ms)))
                .collect(),
            upload_ms: median(&self.uploads_ms),
            n_bytes: mean(&self.n_bytes),
            skipped: mean(&self.skipped),
            peak_gpu_bytes: None,
            frames_ms: self.frames_ms,
        }
    }
}
