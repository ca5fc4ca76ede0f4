//! Very many frames that repeat: recorded once and submitted by the hundred, and compared with the twin now and then.
//!
//! The twin does not follow the whole image. Where nothing moves, what a pixel becomes depends on its own past and on the
//! current colours around it; a piece of the image with a margin as wide as that gives the same pixels as the whole
//! (`amortized` alone looks at its neighbours' past: there the margin is wide, and the piece an approximation). And what is
//! deterministic and comes back to a state it was in will go on as it did: the twin stops there, and so does the adapter unless
//! it is told to do every frame. The twin's last digits may take several periods to come back.

use super::{
    device::{CellError, Device, Left, OnItsWay},
    difference::{self, Bias, Difference, Measure},
    pictures::{Picture, Pictures},
    scenario::{Segment, as_loaded},
};
use crate::{
    gpu::{GpuError, ReadbackPool, Timer},
    image::{Extent, Image},
    sequence::{Frame, frame::Rgb},
    taa::{Precision, Recipe, Repeat, Step, recipe::Weight, reference::Twin},
};
use std::collections::VecDeque;

/// What a long run showed.
#[derive(Debug, Default)]
pub struct Endured {
    /// By frame: how far the adapter is from a twin whose history is never rounded.
    pub errors: Vec<(usize, Difference)>,
    /// How far from one that rounds as the adapter must.
    pub rounded: Difference,
    pub bias: Bias,
    /// The frame, and what is wrong with it.
    pub disorder: Option<(usize, String)>,
    /// From which frame on the adapter's state repeats.
    pub repeats_from: Option<usize>,
    pub n_frames: usize,
    /// Of each frame looked at: the adapter's piece, and the twin's.
    pieces: Vec<Picture>,
}

impl Endured {
    /// The worst frame of those looked at, with the others to compare it with.
    pub fn pictures(&self) -> Option<Pictures> {
        let errors = self.errors.iter().enumerate();
        let (worst, (_, error)) = errors.max_by(|(_, (_, a)), (_, (_, b))| a.max.total_cmp(&b.max))?;
        let picture = |index: usize| self.pieces[index].clone();
        Some(Pictures::around(error.worst, worst, None, self.pieces.len(), picture))
    }
}

/// Frames in one submission.
const BATCH: usize = 128;

pub fn endure(device: Device<'_>, segment: &Segment, period: usize, every_frame: bool) -> Result<Endured, CellError> {
    let period = if period.is_multiple_of(2) { period } else { 2 * period };
    let mut run = Run::new(device, segment, period)?;
    let piece = Piece::of(segment, device.recipe);
    let mut twins = Twins::new(device, segment, &piece, period);
    let mut endured = Endured::default();
    let mut before: Option<(usize, Left)> = None;
    let mut goes_round = false;
    let mut frames = checkpoints(segment.n_frames, period);
    while let Some(frame) = frames.pop_front() {
        device.go_on()?;
        let left = run.go_to(frame)?;
        twins.go_to(frame);
        endured.n_frames = frame + 1;
        if let Some(message) = difference::disorder(&left) {
            endured.disorder = Some((frame, message));
            return Ok(endured);
        }
        piece.compare(device, &left, &twins, frame, &mut endured);
        if endured.repeats_from.is_none()
            && let Some((earlier, before)) = before
            && before.keeps_the_bits_of(&left)
        {
            endured.repeats_from = Some(frame);
            run.cycle = (!every_frame).then_some(frame - earlier);
        }
        if let (Some(_), Some(cycle)) = (run.cycle, twins.cycle())
            && !goes_round
        {
            // What goes round in several periods is looked at once around.
            goes_round = true;
            frames = (1..cycle).map(|n| frame + n * period).collect();
        }
        before = Some((frame, left));
    }
    if goes_round {
        endured.n_frames = segment.n_frames;
    }
    Ok(endured)
}

/// Frames to look at: whole periods, dense at first.
fn checkpoints(n_frames: usize, period: usize) -> VecDeque<usize> {
    let last = n_frames.saturating_sub(1) / period;
    let mut at = VecDeque::new();
    let mut n = 1;
    while n <= last {
        at.push_back(n * period);
        n += (n / 4).clamp(1, (last / 40).max(1));
    }
    if at.back().is_none_or(|end| *end < last * period) && last > 0 {
        at.push_back(last * period);
    }
    at
}

/// The adapter's side.
struct Run<'a> {
    device: Device<'a>,
    resolver: crate::taa::Resolver,
    /// By place in the period.
    steps: Vec<Vec<Step>>,
    pool: ReadbackPool,
    frame: usize,
    /// After how many frames it is known to come back to the same state.
    cycle: Option<usize>,
}

impl<'a> Run<'a> {
    fn new(device: Device<'a>, segment: &Segment, period: usize) -> Result<Self, GpuError> {
        let gpu = device.gpu;
        let mut resolver = device.resolver(segment.sizes)?;
        let mut timer = Timer::new(gpu, 0);
        let mut start = |inputs: &crate::taa::Inputs, resolver: Option<&mut crate::taa::Resolver>| {
            let mut encoder = device.encoder();
            inputs.prepare(gpu, &mut encoder, &mut timer, Repeat::Timed(1))?;
            if let Some(resolver) = resolver {
                resolver.resolve(gpu, &mut encoder, inputs, &mut timer, Repeat::Timed(1))?;
            }
            gpu.queue.submit([encoder.finish()]);
            Ok::<_, GpuError>(())
        };
        let mut first = device.inputs(segment)?;
        first.upload(gpu, &segment.frame(0, device.recipe))?;
        start(&first, Some(&mut resolver))?;
        let mut steps = Vec::with_capacity(period);
        for place in 1..=period {
            let mut inputs = device.inputs(segment)?;
            let frame = segment.frame(place, device.recipe);
            // As this frame's and as the previous frame's.
            inputs.upload(gpu, &frame)?;
            inputs.upload(gpu, &frame)?;
            start(&inputs, None)?;
            // The steps hold what they bind.
            steps.push(resolver.steps(gpu, &inputs)?);
        }
        Ok(Self {
            device,
            resolver,
            steps,
            pool: ReadbackPool::default(),
            frame: 0,
            cycle: None,
        })
    }

    /// What is left after `frame`, which ends a period.
    fn go_to(&mut self, frame: usize) -> Result<Left, GpuError> {
        let gpu = self.device.gpu;
        if let Some(cycle) = self.cycle {
            // Whole rounds change nothing.
            self.frame = frame - (frame - self.frame) % cycle;
        }
        let mut on_its_way = None;
        while self.frame < frame {
            let mut encoder = self.device.encoder();
            let next = self.frame..frame.min(self.frame + BATCH);
            self.frame = next.end;
            let steps = next.flat_map(|index| &self.steps[index % self.steps.len()]);
            Step::record_all(steps, &mut encoder);
            let submitted = gpu.scope("submitting frames", || gpu.queue.submit([encoder.finish()]))?;
            // One runs while the next is recorded.
            if let Some(before) = on_its_way.replace(submitted) {
                gpu.wait(before)?;
            }
        }
        let mut encoder = self.device.encoder();
        let copy = OnItsWay::record(gpu, &self.pool, &mut encoder, &self.resolver);
        let submission = gpu.queue.submit([encoder.finish()]);
        copy.readback.map();
        gpu.wait(submission)?;
        copy.read(&self.resolver)
    }
}

/// What the twin follows of the image: texels from `first` on.
struct Piece {
    first: [u32; 2],
    extent: Extent,
    whole: Extent,
    /// Texels at its rim that are not those of the whole image, where it is cut off there.
    margin: u32,
    scale: u32,
}

impl Piece {
    fn of(segment: &Segment, recipe: &Recipe) -> Self {
        let whole = segment.sizes.render;
        let margin = match recipe.weight {
            Weight::Amortized => 10,
            _ if recipe.variance_window > 7 => recipe.variance_window / 2 + 2,
            _ => 5,
        };
        let side = |side: u32| if side <= 2 * margin + 2 { side } else { 2 * margin + 2 };
        let extent = Extent::new(side(whole.width), side(whole.height));
        // Even, so that a checkerboard keeps its parity.
        let first = [whole.width - extent.width, whole.height - extent.height].map(|rest| (rest / 2) & !1);
        Self {
            first,
            extent,
            whole,
            margin,
            scale: segment.sizes.output.width / whole.width,
        }
    }

    fn cut<T: Copy + Send + Sync>(&self, image: &Image<T>) -> Image<T> {
        let [x0, y0] = self.first;
        Image::from_fn(self.extent, |x, y| image.at(x0 + x, y0 + y))
    }

    fn frame(&self, frame: Frame) -> Frame {
        let motion_px = frame.motion_px.as_ref().map(|motion| {
            let mut cut = self.cut(motion);
            // Whether anything moves is a question to the whole image.
            if let Some(moving) = motion.pixels().iter().find(|m| **m != [0.0; 2] && !m[0].is_nan())
                && !cut.pixels().contains(moving)
            {
                cut.pixels_mut()[0] = *moving;
            }
            cut
        });
        Frame {
            output_size: Extent::new(self.extent.width * self.scale, self.extent.height * self.scale),
            color: self.cut(&frame.color),
            depth: frame.depth.as_ref().map(|image| self.cut(image)),
            motion_px,
            object_id: frame.object_id.as_ref().map(|image| self.cut(image)),
            albedo: frame.albedo.as_ref().map(|image| self.cut(image)),
            reactive: frame.reactive.as_ref().map(|image| self.cut(image)),
            ..frame
        }
    }

    /// Whether an output pixel of the piece is as in the whole image.
    fn is_inner(&self, i: usize) -> bool {
        let width = (self.extent.width * self.scale) as usize;
        let along = |at: usize, first: u32, side: u32, whole: u32| {
            let texel = at as u32 / self.scale;
            (first == 0 || texel >= self.margin) && (first + side == whole || texel + self.margin < side)
        };
        along(i % width, self.first[0], self.extent.width, self.whole.width)
            && along(i / width, self.first[1], self.extent.height, self.whole.height)
    }

    /// The piece of an output image, row by row.
    fn cut_output<T: Copy>(&self, pixels: &[T], n_channels: usize) -> Vec<T> {
        let width = (self.whole.width * self.scale) as usize;
        let [x0, y0] = self.first.map(|at| (at * self.scale) as usize);
        let (w, h) = (
            (self.extent.width * self.scale) as usize,
            (self.extent.height * self.scale) as usize,
        );
        let rows = (y0..y0 + h).map(|y| &pixels[(y * width + x0) * n_channels..][..w * n_channels]);
        rows.flatten().copied().collect()
    }

    fn compare(&self, device: Device<'_>, left: &Left, twins: &Twins, frame: usize, endured: &mut Endured) {
        let extent = Extent::new(self.extent.width * self.scale, self.extent.height * self.scale);
        let measure = Measure::of(device.recipe, device.precision);
        let mut found = self.cut_output(left.shown.pixels(), 1);
        let compare = |found: &mut Vec<Rgb>, expected: &Image<[f64; 3]>| {
            for (i, pixel) in found.iter_mut().enumerate().filter(|(i, _)| !self.is_inner(*i)) {
                *pixel = expected.pixels()[i].map(|c| c as f32);
            }
            let found = Image::from_pixels(extent, found.clone());
            difference::shown(&found, expected, measure)
        };
        endured.errors.push((frame, compare(&mut found, &twins.exact.shown)));
        let of_rounded = compare(&mut found, &twins.rounded.shown);
        if of_rounded.max >= endured.rounded.max {
            endured.rounded = of_rounded;
        }
        if measure.precision == Precision::F16
            && let (Some((_, kept)), Some(history)) = (left.kept.first(), twins.rounded.twin.history())
        {
            let kept = self.cut_output(kept, 4);
            endured.bias.add(&kept, history, |i| self.is_inner(i));
        }
        endured.pieces.push(Picture {
            frame,
            found: Image::from_pixels(extent, found),
            expected: twins.exact.shown.map(|c| c.map(|c| c as f32)),
        });
    }
}

/// A twin that rounds its history as the adapter must, and one that never does.
struct Twins<'a> {
    segment: &'a Segment,
    piece: &'a Piece,
    recipe: &'a Recipe,
    rounded: Followed,
    exact: Followed,
    period: usize,
    frame: usize,
}

struct Followed {
    twin: Twin<f64>,
    shown: Image<[f64; 3]>,
    /// An earlier state, with the number of periods that it was after.
    earlier: Option<(usize, Twin<f64>)>,
    /// In how many periods it comes back to the same state, once that is known.
    cycle: Option<usize>,
}

impl<'a> Twins<'a> {
    fn new(device: Device<'a>, segment: &'a Segment, piece: &'a Piece, period: usize) -> Self {
        let followed = |precision| Followed {
            twin: Twin::new(device.recipe.clone(), precision),
            shown: Image::filled(Extent::new(0, 0), [0.0; 3]),
            earlier: None,
            cycle: None,
        };
        let mut twins = Self {
            segment,
            piece,
            recipe: device.recipe,
            rounded: followed(device.precision),
            exact: followed(Precision::F32),
            period,
            frame: 0,
        };
        let first = twins.input(0);
        twins.rounded.shown = twins.rounded.twin.resolve(&first).shown;
        twins.exact.shown = twins.exact.twin.resolve(&first).shown;
        twins
    }

    fn input(&self, index: usize) -> Frame {
        as_loaded(self.piece.frame((self.segment.frames)(index)), self.recipe)
    }

    fn go_to(&mut self, frame: usize) {
        let inputs: Vec<_> = (1..=self.period).map(|place| self.input(place)).collect();
        let start = self.frame;
        let is_exact = self.recipe.precision(self.rounded.twin.precision()) == Precision::F32;
        self.exact.follow(&inputs, start, frame);
        if is_exact {
            self.rounded.shown = self.exact.shown.clone();
            self.rounded.twin = self.exact.twin.clone();
            self.rounded.cycle = self.exact.cycle;
        } else {
            self.rounded.follow(&inputs, start, frame);
        }
        self.frame = frame;
    }

    /// The longer cycle, in periods, once both have come back to a state that they were in.
    fn cycle(&self) -> Option<usize> {
        Some(self.rounded.cycle?.max(self.exact.cycle?))
    }
}

impl Followed {
    fn follow(&mut self, inputs: &[Frame], from: usize, to: usize) {
        let period = inputs.len();
        let mut index = from;
        while index < to {
            if let Some(cycle) = self.cycle
                && to - index >= cycle * period
            {
                // Whole rounds change nothing.
                index += (to - index) / (cycle * period) * (cycle * period);
                continue;
            }
            self.shown = self.twin.resolve(&inputs[index % period]).shown;
            index += 1;
            if self.cycle.is_none() && index.is_multiple_of(period) {
                self.look_for_cycle(index / period);
            }
        }
    }

    /// Brent's: the state is held against one that is replaced after 1, 2, 4, … periods, so that a cycle of any length is found.
    fn look_for_cycle(&mut self, n_periods: usize) {
        if let Some((earlier, twin)) = &self.earlier
            && twin.is_in_the_state_of(&self.twin)
        {
            self.cycle = Some(n_periods - earlier);
        } else if n_periods.is_power_of_two() {
            self.earlier = Some((n_periods, self.twin.clone()));
        }
    }
}
