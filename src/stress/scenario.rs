//! What a hazard makes of a recipe: frames, and what is asked of them.

use crate::{
    image::{Extent, Image},
    metrics::{Display, Tonemap},
    sequence::{
        Frame, Sizes,
        frame::{Rgb, SKY_DEPTH},
    },
    taa::{Recipe, recipe::InputFilter},
};
use std::sync::Arc;

/// A way to break a recipe. To add one is to add an entry to the list of its family.
#[derive(Clone, Copy, Debug)]
pub struct Hazard {
    /// `family.name`. Stored id; never changes.
    pub id: &'static str,
    /// What happens.
    pub about: &'static str,
    /// Whether `quick` has it.
    pub quick: bool,
    /// Its frames for a recipe.
    pub build: fn(&Setup<'_>) -> Built,
}

/// A scenario, or why the hazard means nothing for the recipe or adapter.
pub type Built = Result<Scenario, NotRun>;

/// Why a cell was not run, in words.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct NotRun(pub String);

/// What a hazard is built for.
#[derive(Clone, Copy, Debug)]
pub struct Setup<'a> {
    /// Under test.
    pub recipe: &'a Recipe,
    /// Size of the frames, where the user asked for one.
    pub size: Option<Extent>,
    /// How many frames, where the user asked for a number.
    pub n_frames: Option<usize>,
    /// Chooses noise and places.
    pub seed: u32,
    /// Fewer frames, for a first look.
    pub quick: bool,
    /// The largest side of a texture on the adapter.
    pub max_side: u32,
}

/// Frame of an index.
pub type Frames = Arc<dyn Fn(usize) -> Frame + Send + Sync>;

/// Frames of one size; the first has no history.
#[derive(Clone)]
pub struct Segment {
    /// Of input and output.
    pub sizes: Sizes,
    /// How many.
    pub n_frames: usize,
    /// Each of them.
    pub frames: Frames,
    /// The frame from which on each is equal to that two before it, but for a checkerboard's parity.
    pub alternates_from: Option<usize>,
}

/// Frames, and what is asked of them beside finite values and agreement with the twin.
#[derive(Clone)]
pub struct Scenario {
    /// One after the other, each beginning without history.
    pub segments: Vec<Segment>,
    /// What else is asked.
    pub asks: Asks,
}

/// What is asked of a recipe beside finite values and agreement with the twin.
#[derive(Clone)]
pub enum Asks {
    /// Nothing else.
    Agreement,
    /// That a disturbance is forgotten: outside what it touched after one frame, there in the end.
    Recovery {
        /// The same frames without it.
        undisturbed: Frames,
        /// The frame that has it.
        frame: usize,
        /// The input texels that were changed: first column and row, and the columns and rows behind the last.
        area: [[u32; 2]; 2],
    },
    /// That error does not grow over very many frames that repeat with this period. Depth and ids are the same in all.
    Endurance {
        /// Frames.
        period: usize,
    },
    /// That a dot in the image keeps its energy and place.
    Dot {
        /// The colour around it, linear.
        ground: f64,
    },
    /// That stored history has the twin's digits, where it is not rounded to f16: within so many steps of f32.
    Digits {
        /// Steps.
        ulps: f64,
    },
    /// That white noise settles at the variance that theory gives.
    Noise,
    /// Equal bits, however the work is done.
    Order(Order),
}

/// What may not change a bit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Order {
    /// The same frames once more.
    Repeat,
    /// How many threads of the host take part.
    Threads,
    /// Whether what repeats is computed again.
    Skip,
    /// The shape of the tiles that invocations are grouped in, and so their order.
    Tiles,
}

impl Setup<'_> {
    /// The size asked for, else `usual`; an error where the adapter has no such textures.
    pub fn sizes(&self, usual: Extent) -> Result<Sizes, NotRun> {
        let render = self.size.unwrap_or(usual);
        self.exactly(render)
    }

    /// This size, whatever was asked for.
    pub fn exactly(&self, render: Extent) -> Result<Sizes, NotRun> {
        let scale = self.scale();
        let output = Extent::new(render.width * scale, render.height * scale);
        let side = output.width.max(output.height);
        if side > self.max_side {
            let limit = self.max_side;
            return Err(NotRun(format!(
                "an output of {output} has more than the {limit} pixels a side that the adapter's textures can have"
            )));
        }
        Ok(Sizes { render, output })
    }

    /// Output pixels for an input pixel: a recipe that upsamples is made to.
    pub fn scale(&self) -> u32 {
        if self.recipe.input_filter == InputFilter::Upsample {
            2
        } else {
            1
        }
    }

    /// The number asked for, else the usual one.
    pub fn frames(&self, usual: usize, quick: usize) -> usize {
        self.n_frames.unwrap_or(if self.quick { quick } else { usual })
    }

    /// Frames of one size.
    pub fn scenario(
        &self,
        sizes: Sizes,
        n_frames: usize,
        asks: Asks,
        frames: impl Fn(usize) -> Frame + Send + Sync + 'static,
    ) -> Scenario {
        Scenario {
            segments: vec![Segment {
                sizes,
                n_frames,
                frames: Arc::new(frames),
                alternates_from: None,
            }],
            asks,
        }
    }

    /// A scene at rest whose [`BAD_FRAME`] is disturbed in the input texels of `area`.
    pub fn recovery(
        &self,
        sizes: Sizes,
        area: [[u32; 2]; 2],
        disturb: impl Fn(&mut Frame) + Send + Sync + 'static,
    ) -> Scenario {
        let seed = self.seed;
        let undisturbed: Frames = Arc::new(move |index| still(sizes, index, seed));
        let asks = Asks::Recovery {
            undisturbed: Arc::clone(&undisturbed),
            frame: BAD_FRAME,
            area,
        };
        let n_frames = self.frames(80, 64).max(BAD_FRAME + 2);
        let mut scenario = self.scenario(sizes, n_frames, asks, move |index| {
            let mut frame = undisturbed(index);
            if index == BAD_FRAME {
                disturb(&mut frame);
            }
            frame
        });
        scenario.segments[0].alternates_from = Some(BAD_FRAME + 1);
        scenario
    }
}

/// The frame that is disturbed.
pub const BAD_FRAME: usize = 6;

/// The texel in the middle of a frame as an area; of a checkerboard's [`BAD_FRAME`], one that is shaded.
pub fn middle(extent: Extent) -> [[u32; 2]; 2] {
    let [x, y] = [extent.width / 2, extent.height / 2];
    let x = x.saturating_sub((x + y + BAD_FRAME as u32) % 2);
    [[x, y], [x + 1, y + 1]]
}

impl Segment {
    /// The frame as the loader would hand it to `recipe`.
    pub fn frame(&self, index: usize, recipe: &Recipe) -> Frame {
        as_loaded((self.frames)(index), recipe)
    }

    /// Whether after `n_frames` all that follow repeat the last two: their input does, and what is deterministic has come back to
    /// the state of two frames before, which `is_equal` compares.
    pub fn has_settled(&self, n_frames: usize, is_equal: impl Fn(usize, usize) -> bool) -> bool {
        let is_back = |from| n_frames >= from + 3 && is_equal(n_frames - 1, n_frames - 3);
        self.alternates_from.is_some_and(is_back)
    }
}

/// Leaves out what a checkerboard does not shade, where the recipe expects one.
pub fn as_loaded(mut frame: Frame, recipe: &Recipe) -> Frame {
    if !recipe.fills_checkerboard() {
        return frame;
    }
    let parity = frame.index as u32 % 2;
    frame.parity = Some(parity);
    frame.color = shaded(&frame.color, parity, [0.0; 3]);
    frame.depth = frame.depth.as_ref().map(|image| shaded(image, parity, SKY_DEPTH));
    frame.motion_px = frame
        .motion_px
        .as_ref()
        .map(|image| shaded(image, parity, [f32::NAN; 2]));
    frame
}

fn shaded<T: Copy + Send + Sync>(image: &Image<T>, parity: u32, nothing: T) -> Image<T> {
    Image::from_fn(image.extent(), |x, y| {
        if (x + y) % 2 == parity { image.at(x, y) } else { nothing }
    })
}

/// How frames are shown.
pub const DISPLAY: Display = Display {
    exposure: 1.0,
    tonemap: Tonemap::ReinhardMax,
};

/// A frame of one colour at rest: what hazards start from.
pub fn blank(sizes: Sizes, index: usize, color: Rgb) -> Frame {
    let extent = sizes.render;
    Frame {
        index,
        reset: false,
        jitter_px: [0.0; 2],
        far: 100.0,
        output_size: sizes.output,
        parity: None,
        display: DISPLAY,
        color: Image::filled(extent, color),
        depth: Some(Image::filled(extent, 5.0)),
        motion_px: Some(Image::filled(extent, [0.0; 2])),
        object_id: Some(Image::filled(extent, 1)),
        albedo: Some(Image::filled(extent, [0.5; 3])),
        reactive: Some(Image::filled(extent, 0.0)),
        unjittered_color: None,
        reference: None,
        others: None,
    }
}

/// A frame of a textured wall with a box before it, at rest.
pub fn still(sizes: Sizes, index: usize, seed: u32) -> Frame {
    moving(sizes, index, seed, [0.0; 2])
}

/// The same scene, seen from `at` pixels further; at rest unless the caller says how it moved.
pub fn moving(sizes: Sizes, index: usize, seed: u32, at: [f64; 2]) -> Frame {
    let mut frame = blank(sizes, index, [0.0; 3]);
    let extent = sizes.render;
    let phase = f64::from(seed % 64) * 0.1;
    let on_box = |x: u32, y: u32| x * 3 / extent.width == 1 && y * 3 / extent.height == 1;
    frame.color = Image::from_fn(extent, |x, y| {
        let (x, y) = (f64::from(x) + at[0], f64::from(y) + at[1]);
        let wave = |u: f64| 0.5 + 0.5 * libm::sin(u + phase);
        let place = [(x - at[0]) as u32, (y - at[1]) as u32];
        if on_box(place[0], place[1]) {
            return [0.7, 0.2 + 0.1 * wave(x * 1.1), 0.05].map(|c| c as f32);
        }
        let texture = wave(x * 0.9 + y * 0.35);
        [
            0.15 + 0.7 * texture,
            0.3 + 0.3 * wave(y * 0.8 - x * 0.2),
            0.4 - 0.2 * texture,
        ]
        .map(|c| c as f32)
    });
    frame.depth = Some(Image::from_fn(extent, |x, y| {
        if on_box(x, y) { 2.0 } else { 5.0 + 0.01 * (x + y) as f32 }
    }));
    frame.object_id = Some(Image::from_fn(extent, |x, y| 1 + u32::from(on_box(x, y))));
    frame.albedo = Some(frame.color.clone());
    frame
}

/// A jitter of 16 places, Halton's bases 2 and 3.
pub fn halton_px(index: usize) -> [f64; 2] {
    [2_u32, 3].map(|base| {
        let (mut i, mut digit, mut sum) = (index as u32 % 16 + 1, 1.0, 0.0);
        while i > 0 {
            digit /= f64::from(base);
            sum += digit * f64::from(i % base);
            i /= base;
        }
        sum - 0.5
    })
}

/// Repeatable noise in 0..1.
pub fn noise(x: u32, y: u32, seed: u32) -> f32 {
    let mut h = x.wrapping_mul(0x9e37_79b9) ^ y.wrapping_mul(0x85eb_ca6b) ^ seed.wrapping_mul(0xc2b2_ae35);
    h = (h ^ (h >> 15)).wrapping_mul(0x2c1b_3c6d);
    h = (h ^ (h >> 12)).wrapping_mul(0x297a_2d39);
    ((h ^ (h >> 15)) >> 8) as f32 / 16_777_216.0
}
