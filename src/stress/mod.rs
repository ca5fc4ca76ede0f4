//! Numerical stability: hazards that break a temporal resolve, every recipe against each of them, and what became of it.
//!
//! A hazard ([`Hazard`]) is a generator of frames with what is asked of them. A cell is a hazard on a recipe at a precision: the
//! adapter's images are compared frame by frame with those of the f64 twin, everything that it stores is read back and must be
//! finite, and the error's growth is fitted. Knows recipes, frames and the GPU; neither HTTP nor SQL.

mod cell;
mod device;
mod difference;
mod endurance;
mod findings;
mod growth;
mod hazards;
mod markdown;
mod pictures;
mod probes;
pub mod report;
mod scenario;
mod sketch;

pub use growth::{Growth, Trend};
pub use hazards::all as hazards;
pub use markdown::markdown;
pub use pictures::Pictures;
pub use scenario::Hazard;
pub use sketch::{Sketch, SketchedFrame, Weakness};

use crate::{
    gpu::{Gpu, GpuError},
    image::Extent,
    run::{PresetSpec, RunError},
    taa::{
        Fault, PRESETS, Precision, Preset, Recipe, Skip,
        recipe::{Algorithm, Guards, HistoryFilter},
    },
};
use device::{CellError, Device};
use rayon::prelude::*;
use report::{Cell, StressReport, Verdict};
use scenario::{Asks, NotRun, Scenario, Segment, Setup};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::{
    cmp::Reverse,
    sync::{
        Mutex,
        atomic::{AtomicUsize, Ordering::Relaxed},
    },
};

/// Which cells to run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct StressSpec {
    /// Which recipes; every preset where empty.
    pub presets: Vec<PresetSpec>,
    /// Ids of hazards, or of their families; all where empty.
    pub hazards: Vec<String>,
    /// How history is stored.
    pub precisions: Vec<Precision>,
    /// With what makes recipes stable, or without.
    pub guards: Vec<Guards>,
    /// Size of the frames, pixels; each hazard's own where left out. Hazards of shape keep theirs.
    pub size: Option<Extent>,
    /// Number of frames; each hazard's own where left out.
    pub n_frames: Option<usize>,
    /// Chooses noise and places.
    pub seed: u32,
    /// Fewer hazards, and fewer frames of them.
    pub quick: bool,
    /// Do every frame of very many, even where the state repeats.
    pub every_frame: bool,
}

impl Default for StressSpec {
    fn default() -> Self {
        Self {
            presets: Vec::new(),
            hazards: Vec::new(),
            precisions: vec![Precision::F16, Precision::F32],
            guards: vec![Guards::On],
            size: None,
            n_frames: None,
            seed: 1,
            quick: false,
            every_frame: false,
        }
    }
}

/// Watches a run from outside. Called from many threads.
pub trait Observer: Sync {
    /// A cell is done; `n_done` of `n_total` are. No pictures where nothing ran.
    fn cell(&self, index: usize, cell: &Cell, pictures: Option<&Pictures>, n_done: usize, n_total: usize);
    /// Asked between frames; `true` ends the run with [`RunError::Cancelled`].
    fn cancelled(&self) -> bool;
}

/// A cell to be run.
struct Planned<'a> {
    hazard: &'static Hazard,
    system: &'a System,
    precision: Precision,
}

/// A recipe by the name that cells have.
struct System {
    name: String,
    recipe: Recipe,
}

/// The most pixels a side of a frame; with the most frames, so that no request fills the memory.
pub const MAX_SIDE: u32 = 16384;
/// The most frames of a hazard.
pub const MAX_FRAMES: usize = 10_000_000;

/// Cells that run at once, for every thread of the host: most of the time one waits for the adapter.
const THREADS_PER_CPU: usize = 2;

/// Checks everything that can be known before a run.
pub fn validate(spec: &StressSpec) -> Result<(), RunError> {
    plan(spec).map(drop)
}

fn plan(spec: &StressSpec) -> Result<(Vec<System>, Vec<&'static Hazard>), RunError> {
    let input = |field: &str, message: String| RunError::Input(format!("{field}: {message}"));
    if spec.precisions.is_empty() || spec.guards.is_empty() {
        return Err(input("precisions", "name at least one, and one of guards".to_owned()));
    }
    if let Some(size) = spec.size
        && !((1..=MAX_SIDE).contains(&size.width) && (1..=MAX_SIDE).contains(&size.height))
    {
        return Err(input("size", format!("must be 1 to {MAX_SIDE} a side, not {size}")));
    }
    if spec.n_frames.is_some_and(|n| !(1..=MAX_FRAMES).contains(&n)) {
        return Err(input("n_frames", format!("must be 1 to {MAX_FRAMES}")));
    }
    Ok((systems(spec)?, chosen(spec)?))
}

fn systems(spec: &StressSpec) -> Result<Vec<System>, RunError> {
    const ALL: &[Preset] = &PRESETS;
    let every = ALL.iter().map(|preset| PresetSpec {
        preset: preset.id.to_owned(),
        parameters: serde_json::Map::new(),
    });
    let wanted = if spec.presets.is_empty() {
        every.collect()
    } else {
        spec.presets.clone()
    };
    let mut systems = Vec::new();
    for wanted in wanted {
        let failed = |message: String| RunError::Input(format!("presets: {message}"));
        let preset = Preset::find(&wanted.preset).map_err(|error| failed(error.to_string()))?;
        let recipe = preset
            .recipe
            .with(&wanted.parameters)
            .map_err(|error| failed(error.to_string()))?;
        recipe.check_gpu().map_err(|error| failed(error.to_string()))?;
        let mut name = wanted.preset.clone();
        for (parameter, value) in &wanted.parameters {
            name += &format!(", {parameter} {}", value.to_string().trim_matches('"'));
        }
        for &guards in &spec.guards {
            let mut recipe = recipe.clone();
            recipe.guards = guards;
            systems.push(System {
                name: name.clone(),
                recipe,
            });
        }
    }
    Ok(systems)
}

fn chosen(spec: &StressSpec) -> Result<Vec<&'static Hazard>, RunError> {
    let matches = |hazard: &Hazard, wanted: &str| hazard.id == wanted || hazard.id.split('.').next() == Some(wanted);
    if let Some(unknown) = spec
        .hazards
        .iter()
        .find(|wanted| !hazards().any(|hazard| matches(hazard, wanted)))
    {
        let nearest = hazards()
            .map(|hazard| hazard.id)
            .max_by(|a, b| strsim::jaro_winkler(unknown, a).total_cmp(&strsim::jaro_winkler(unknown, b)))
            .unwrap_or_default();
        return Err(RunError::Input(format!(
            "hazards: there is no hazard or family `{unknown}`; did you mean `{nearest}`?"
        )));
    }
    let is_wanted = |hazard: &&Hazard| match spec.hazards.is_empty() {
        true => hazard.quick || !spec.quick,
        false => spec.hazards.iter().any(|wanted| matches(hazard, wanted)),
    };
    Ok(hazards().filter(is_wanted).collect())
}

/// Runs every cell of `spec`, several at a time.
pub fn execute(spec: &StressSpec, gpu: &Gpu, observer: &dyn Observer) -> Result<StressReport, RunError> {
    execute_with_fault(spec, gpu, observer, None)
}

/// The same with a mistake in one pass, for tests. A recipe that has no such pass runs without it.
pub fn execute_with_fault(
    spec: &StressSpec,
    gpu: &Gpu,
    observer: &dyn Observer,
    fault: Option<Fault<'_>>,
) -> Result<StressReport, RunError> {
    let (systems, hazards) = plan(spec)?;
    let devices = Devices::of(gpu)?;
    let mut planned = Vec::new();
    for hazard in hazards {
        for system in &systems {
            planned.extend(spec.precisions.iter().map(|&precision| Planned {
                hazard,
                system,
                precision,
            }));
        }
    }
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(THREADS_PER_CPU * rayon::current_num_threads())
        .build()
        .expect("a few threads can be had");
    let n_done = AtomicUsize::new(0);
    let n_total = planned.len();
    let n_precisions = spec.precisions.len();
    let run_group = |(group, planned): (usize, &[Planned<'_>])| {
        let mut ran: Vec<(Precision, Cell, Option<Pictures>)> = Vec::with_capacity(n_precisions);
        for (place, planned) in planned.iter().enumerate() {
            if observer.cancelled() {
                return Err(RunError::Cancelled);
            }
            let precision = planned.stored_precision();
            let known = ran.iter().find(|(known, ..)| *known == precision).cloned();
            let (mut cell, pictures) = match known {
                Some((_, cell, pictures)) => (cell, pictures),
                None => devices.lend(|gpu| planned.run(spec, gpu, fault, &|| observer.cancelled()))?,
            };
            cell.precision = planned.precision;
            let n_done = n_done.fetch_add(1, Relaxed) + 1;
            observer.cell(group * n_precisions + place, &cell, pictures.as_ref(), n_done, n_total);
            ran.push((precision, cell, pictures));
        }
        let cells: Vec<_> = ran.into_iter().map(|(_, cell, _)| cell).collect();
        Ok((group, cells))
    };
    // The longest first, so that none is left to run alone in the end.
    let mut groups: Vec<_> = planned.chunks(n_precisions).enumerate().collect();
    groups.sort_by_cached_key(|(_, planned)| Reverse(planned[0].n_pixels(spec, gpu)));
    let in_turn = || groups.into_iter().par_bridge().map(run_group);
    let mut ran: Vec<_> = pool.install(|| in_turn().collect::<Result<_, RunError>>())?;
    ran.sort_by_key(|(group, _)| *group);
    let cells = ran.into_iter().flat_map(|(_, cells)| cells);
    Ok(StressReport {
        adapter: gpu.info(),
        revision: env!("AFTERIMAGE_REVISION").to_owned(),
        seed: spec.seed,
        cells: cells.collect(),
    })
}

/// What cells run on. A CPU adapter does the work of one device on one thread, so there are two of it.
struct Devices {
    gpus: Vec<Gpu>,
    /// How many cells each has.
    n_running: Mutex<Vec<usize>>,
}

impl Devices {
    fn of(gpu: &Gpu) -> Result<Self, RunError> {
        // Hazards share recipes, and recipes passes.
        let mut gpus = vec![gpu.caching()];
        if gpu.is_cpu() {
            gpus.push(gpu.second()?.caching());
        }
        let n_running = Mutex::new(vec![0; gpus.len()]);
        Ok(Self { gpus, n_running })
    }

    /// Runs a cell on the device that has the fewest.
    fn lend<T>(&self, cell: impl FnOnce(&Gpu) -> T) -> T {
        let n_running = || self.n_running.lock().expect("no panic while it is held");
        let chosen = {
            let mut n_running = n_running();
            let least = (0..n_running.len()).min_by_key(|&i| n_running[i]).unwrap_or_default();
            n_running[least] += 1;
            least
        };
        let done = cell(&self.gpus[chosen]);
        n_running()[chosen] -= 1;
        done
    }
}

/// Frames are kept until all have been looked at; this much memory they may take.
const MAX_BYTES: usize = 1 << 30;

fn too_large(scenario: &Scenario) -> Option<String> {
    if matches!(scenario.asks, Asks::Endurance { .. }) {
        return None;
    }
    let of_segment = |segment: &Segment| segment.n_frames * segment.sizes.output.n_pixels() * 48;
    let bytes: usize = scenario.segments.iter().map(of_segment).sum();
    (bytes > MAX_BYTES).then(|| {
        let mib = bytes >> 20;
        format!("its frames would take {mib} MiB at once; ask for a smaller size or fewer frames")
    })
}

impl Planned<'_> {
    /// A recipe that keeps no history is the same at every precision, and so is one that always keeps f32.
    fn stored_precision(&self) -> Precision {
        let recipe = &self.system.recipe;
        match recipe.algorithm == Algorithm::Temporal && recipe.history_filter == HistoryFilter::None {
            true => Precision::F32,
            false => recipe.precision(self.precision),
        }
    }

    fn setup<'b>(&'b self, spec: &StressSpec, gpu: &Gpu) -> Setup<'b> {
        Setup {
            recipe: &self.system.recipe,
            size: spec.size,
            n_frames: spec.n_frames,
            seed: spec.seed,
            quick: spec.quick,
            max_side: gpu.max_side(),
        }
    }

    /// How much there is to do.
    fn n_pixels(&self, spec: &StressSpec, gpu: &Gpu) -> usize {
        let of_segment = |segment: &Segment| segment.n_frames * segment.sizes.output.n_pixels();
        let scenario = (self.hazard.build)(&self.setup(spec, gpu));
        scenario.map_or(0, |scenario| scenario.segments.iter().map(of_segment).sum())
    }

    fn run(
        &self,
        spec: &StressSpec,
        gpu: &Gpu,
        fault: Option<Fault<'_>>,
        is_cancelled: &(dyn Fn() -> bool + Sync),
    ) -> Result<(Cell, Option<Pictures>), RunError> {
        let recipe = &self.system.recipe;
        let setup = self.setup(spec, gpu);
        let mut cell = Cell {
            hazard: self.hazard.id.to_owned(),
            recipe: self.system.name.clone(),
            precision: self.precision,
            guards: recipe.guards,
            adapter: gpu.info().name,
            verdict: Verdict::NotRun,
            reason: String::new(),
            max_error: crate::metrics::Value(0.0),
            max_error_ulps: crate::metrics::Value(0.0),
            frame: None,
            recovered_after: None,
            course: Vec::new(),
            growth: None,
            bound: None,
            pictured: Vec::new(),
            size: spec.size.unwrap_or(Extent::new(0, 0)),
            n_frames: 0,
            digest: String::new(),
        };
        let scenario = match (self.hazard.build)(&setup) {
            Ok(scenario) => scenario,
            Err(NotRun(reason)) => {
                cell.reason = reason;
                return Ok((cell, None));
            }
        };
        let device = Device {
            gpu,
            recipe,
            precision: self.stored_precision(),
            skip: Skip::Off,
            fault,
            is_cancelled,
        };
        if let Some(reason) = too_large(&scenario) {
            cell.reason = reason;
            return Ok((cell, None));
        }
        let (findings, pictures) = match cell::run(device, &scenario, spec.every_frame) {
            Err(CellError::Gpu(GpuError::Unsupported { message, .. })) => {
                cell.reason = format!("the adapter {message}");
                return Ok((cell, None));
            }
            Err(CellError::Gpu(error)) => return Err(error.into()),
            Err(CellError::Cancelled) => return Err(RunError::Cancelled),
            Ok(ran) => ran,
        };
        cell.verdict = findings.verdict();
        cell.reason = findings.reason();
        cell.max_error = crate::metrics::Value(findings.max);
        cell.max_error_ulps = crate::metrics::Value(findings.max_ulps);
        cell.frame = findings.frame();
        cell.recovered_after = findings.recovered_after;
        cell.course = report::thinned(&findings.errors);
        cell.growth = findings.growth;
        cell.size = scenario.segments[0].sizes.render;
        cell.n_frames = findings.n_frames;
        cell.digest = findings.digest;
        cell.bound = findings.bound;
        cell.pictured = pictures.as_ref().map(Pictures::frames).unwrap_or_default();
        Ok((cell, pictures))
    }
}
