//! Whole frames from a few small numbers, for fuzzing: what a fuzzer or a property test draws, and shrinks, is a sketch; a
//! sketch that a recipe does not stand is written as a sequence that `afterimage run` reads.

use super::{
    device::{CellError, Device, Left},
    difference::{self, Measure},
    scenario::{Segment, as_loaded, blank},
};
use crate::{
    gpu::{Gpu, GpuError},
    image::{
        Extent, Image,
        files::{
            ImageError, Plane,
            exr::{Compression, FloatFormat, write_exr},
        },
    },
    sequence::{Frame, Sizes},
    taa::{Precision, Recipe, Skip, recipe::InputFilter, reference::Twin},
};
use serde_json::json;
use std::{fs, io, path::Path, sync::Arc};

/// Frames of one small size.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Sketch {
    /// Texels, 1 to [`Sketch::MAX_SIDE`].
    pub width: u32,
    /// Texels, 1 to [`Sketch::MAX_SIDE`].
    pub height: u32,
    /// At least one.
    pub frames: Vec<SketchedFrame>,
}

/// One of them. A texel takes the number at its place in each list, again from the start where that ends: an empty list is
/// plain everywhere, and 0 stands for what is plain.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct SketchedFrame {
    /// History is dropped before.
    pub reset: bool,
    /// In 256ths of a pixel, along x and y.
    pub jitter: [i8; 2],
    /// Places in the list of colours' values: red by the lowest four bits, green and blue by those and the next.
    pub colors: Vec<u8>,
    /// Places in the list of vectors.
    pub motion: Vec<u8>,
    /// Places in the list of depths.
    pub depth: Vec<u8>,
    /// Object ids.
    pub ids: Vec<u8>,
}

const COLORS: [f32; 16] = [
    0.5,
    0.25,
    0.0,
    1.0,
    0.333_3,
    3.0,
    1e-3,
    40.0,
    2047.0,
    f32::NAN,
    f32::INFINITY,
    f32::NEG_INFINITY,
    -1.0,
    65504.0,
    1e30,
    -0.0,
];
const MOTION_PX: [[f32; 2]; 16] = [
    [0.0, 0.0],
    [0.5, 0.0],
    [0.0, -0.5],
    [1.0, 1.0],
    [-0.37, 0.21],
    [2.25, -1.75],
    [1e-3, 0.0],
    [20.0, 0.0],
    [-0.25, 0.25],
    [f32::NAN, 0.0],
    [0.0, f32::INFINITY],
    [1e6, 0.0],
    [1e30, -1e30],
    [-1e-40, 0.0],
    [0.500_000_06, 0.0],
    [16.0, 3.0],
];
const DEPTHS: [f32; 8] = [5.0, 2.0, 5.000_001, 0.0, -1.0, f32::NAN, f32::INFINITY, 1e10];

/// Some digits of f32, which its rounding may lose.
const NUDGE: f32 = 1e-6;

/// A bit more or a bit less than 1.
fn by_turns(x: u32, y: u32, seed: u32) -> f32 {
    match (x * 7 + y * 13 + seed).wrapping_mul(2_654_435_761) >> 31 {
        0 => 1.0 + NUDGE,
        _ => 1.0 - NUDGE,
    }
}

/// Why a recipe does not stand a sketch.
#[derive(Debug, thiserror::Error)]
pub enum Weakness {
    /// A value that is not finite, or beyond its limit.
    #[error("frame {frame}: {who} {message}")]
    Disorder {
        /// Which frame.
        frame: usize,
        /// The GPU, or a twin.
        who: &'static str,
        /// What it does.
        message: String,
    },
    /// Two that should agree and do not, by more than the rounding of inputs explains.
    #[error(
        "frame {frame}: {who} and the f64 twin differ by {error:.2e} in {n_pixels} pixels that rounding does not explain"
    )]
    Disagreement {
        /// Which frame.
        frame: usize,
        /// The GPU, or the f32 twin.
        who: &'static str,
        /// Display units.
        error: f64,
        /// How many pixels.
        n_pixels: usize,
    },
    /// The adapter failed.
    #[error(transparent)]
    Gpu(#[from] GpuError),
}

impl Sketch {
    /// The most texels along a side.
    pub const MAX_SIDE: u32 = 12;
    /// The most frames that bytes can ask for.
    const MAX_FRAMES: usize = 6;

    /// From whatever a fuzzer has; too few bytes are followed by zeros.
    pub fn from_bytes(bytes: &[u8]) -> Self {
        let mut bytes = bytes.iter().copied();
        let mut next = || bytes.next().unwrap_or_default();
        let (width, height) = (
            1 + u32::from(next()) % Self::MAX_SIDE,
            1 + u32::from(next()) % Self::MAX_SIDE,
        );
        let n_frames = 1 + usize::from(next()) % Self::MAX_FRAMES;
        let frames = (0..n_frames).map(|_| {
            let mut list = |most: usize| {
                let n = usize::from(next()) % (most + 1);
                (0..n).map(|_| next()).collect::<Vec<_>>()
            };
            let (colors, motion, depth, ids) = (list(24), list(12), list(8), list(4));
            SketchedFrame {
                reset: next() % 8 == 7,
                jitter: [next() as i8, next() as i8],
                colors,
                motion,
                depth,
                ids,
            }
        });
        Self {
            width,
            height,
            frames: frames.collect(),
        }
    }

    /// Frame `index` for a recipe; `nudge` changes its colours and vectors by a millionth: colours one way or the other from texel
    /// to texel, vectors all longer (1), all shorter (2) or by turns (3), because many lie on an edge together.
    pub fn frame(&self, index: usize, recipe: &Recipe, nudge: Option<u32>) -> Frame {
        let sketched = &self.frames[index];
        let at = |list: &[u8], x: u32, y: u32| match list {
            [] => 0,
            list => list[(y * self.width + x) as usize % list.len()],
        };
        let mut frame = blank(self.sizes(recipe), index, [0.0; 3]);
        let extent = frame.extent();
        frame.reset = sketched.reset;
        frame.jitter_px = sketched.jitter.map(|j| f64::from(j) / 256.0);
        frame.color = Image::from_fn(extent, |x, y| {
            let n = usize::from(at(&sketched.colors, x, y));
            let color = [n % 16, (n + n / 16) % 16, (n + 3 * (n / 16)) % 16].map(|i| COLORS[i]);
            color.map(|c| c * nudge.map_or(1.0, |seed| by_turns(x, y, seed)))
        });
        frame.motion_px = Some(Image::from_fn(extent, |x, y| {
            let factor = match nudge {
                None => 1.0,
                Some(1) => 1.0 + NUDGE,
                Some(2) => 1.0 - NUDGE,
                Some(seed) => by_turns(x, y, seed),
            };
            MOTION_PX[usize::from(at(&sketched.motion, x, y)) % MOTION_PX.len()].map(|px| px * factor)
        }));
        frame.depth = Some(Image::from_fn(extent, |x, y| {
            DEPTHS[usize::from(at(&sketched.depth, x, y)) % DEPTHS.len()]
        }));
        frame.object_id = Some(Image::from_fn(extent, |x, y| u32::from(at(&sketched.ids, x, y))));
        frame.albedo = Some(frame.color.clone());
        as_loaded(frame, recipe)
    }

    fn sizes(&self, recipe: &Recipe) -> Sizes {
        let scale = if recipe.input_filter == InputFilter::Upsample {
            2
        } else {
            1
        };
        Sizes {
            render: Extent::new(self.width, self.height),
            output: Extent::new(self.width * scale, self.height * scale),
        }
    }

    /// Runs a recipe's twins, and where there is one the adapter: everything must be finite, and all must agree but where a
    /// change of the input's last digits changes the result as much.
    pub fn check(&self, recipe: &Recipe, precision: Precision, gpu: Option<&Gpu>) -> Result<(), Weakness> {
        let measure = Measure::of(recipe, precision);
        let exact = self.twin::<f64>(recipe, precision, None);
        let single = self.twin::<f32>(recipe, precision, None);
        let nudged = [1, 2, 3].map(|seed| self.twin::<f64>(recipe, precision, Some(seed)));
        for (frame, images) in exact.iter().zip(&single).enumerate() {
            for (who, image) in [("the f64 twin", images.0), ("the f32 twin", images.1)] {
                if image.pixels().iter().flatten().any(|v| !v.is_finite()) {
                    let message = "shows a value that is not finite".to_owned();
                    return Err(Weakness::Disorder { frame, who, message });
                }
            }
        }
        let spread = |frame: usize, i: usize| {
            let at = |image: &Image<[f64; 3]>| difference::displayed(image.pixels()[i], measure.domain);
            let expected = at(&exact[frame]);
            let others = nudged.iter().map(|all| at(&all[frame]));
            others.fold(0.0, |spread: f64, other| spread.max(distance(other, expected)))
        };
        let agrees = |who: &'static str, frame: usize, found: &Image<[f64; 3]>, also: Option<&Image<[f64; 3]>>| {
            let (mut n_pixels, mut error) = (0, 0.0_f64);
            for (i, (a, b)) in found.pixels().iter().zip(exact[frame].pixels()).enumerate() {
                let d = distance(
                    difference::displayed(*a, measure.domain),
                    difference::displayed(*b, measure.domain),
                );
                let like_single = also.map_or(f64::INFINITY, |also| {
                    distance(
                        difference::displayed(*a, measure.domain),
                        difference::displayed(also.pixels()[i], measure.domain),
                    )
                });
                if d.min(like_single) > measure.tolerance + 8.0 * spread(frame, i) {
                    n_pixels += 1;
                    error = error.max(d);
                }
            }
            // A decision may fall otherwise where no nudge happened to show it.
            match n_pixels > 2 {
                true => Err(Weakness::Disagreement {
                    frame,
                    who,
                    error,
                    n_pixels,
                }),
                false => Ok(()),
            }
        };
        for (frame, image) in single.iter().enumerate() {
            agrees("the f32 twin", frame, image, None)?;
        }
        let Some(gpu) = gpu else { return Ok(()) };
        for (frame, left) in self.on_adapter(recipe, precision, gpu)?.iter().enumerate() {
            let blown = || difference::blown(&left.shown, &exact[frame], recipe.domain);
            if let Some(message) = difference::disorder(left).or_else(blown) {
                return Err(Weakness::Disorder {
                    frame,
                    who: "the GPU",
                    message,
                });
            }
            let shown = left.shown.map(|pixel| pixel.map(f64::from));
            agrees("the GPU", frame, &shown, Some(&single[frame]))?;
        }
        Ok(())
    }

    fn twin<R: crate::taa::reference::real::Real>(
        &self,
        recipe: &Recipe,
        precision: Precision,
        nudge: Option<u32>,
    ) -> Vec<Image<[f64; 3]>> {
        let mut twin = Twin::<R>::new(recipe.clone(), precision);
        let frames = (0..self.frames.len()).map(|index| self.frame(index, recipe, nudge));
        frames
            .map(|frame| twin.resolve(&frame).shown.map(|c| c.map(R::to_f64)))
            .collect()
    }

    fn on_adapter(&self, recipe: &Recipe, precision: Precision, gpu: &Gpu) -> Result<Vec<Left>, GpuError> {
        let frames: Vec<_> = (0..self.frames.len())
            .map(|index| self.frame(index, recipe, None))
            .collect();
        let segment = Segment {
            sizes: self.sizes(recipe),
            n_frames: frames.len(),
            frames: Arc::new(move |index| frames[index].clone()),
            alternates_from: None,
        };
        let device = Device {
            gpu,
            recipe,
            precision,
            skip: Skip::Off,
            fault: None,
            is_cancelled: &|| false,
        };
        match device.resolve(&segment, |index| (segment.frames)(index)) {
            Err(CellError::Gpu(error)) => Err(error),
            Err(CellError::Cancelled) => unreachable!("nobody cancels it"),
            Ok(left) => Ok(left),
        }
    }

    /// Writes it as a sequence: a manifest, and an EXR file a frame.
    pub fn write(&self, folder: &Path, name: &str, recipe: &Recipe) -> Result<(), ImageError> {
        let at = |path: &Path| {
            let path = path.to_owned();
            move |source: io::Error| ImageError::Io { path, source }
        };
        fs::create_dir_all(folder).map_err(at(folder))?;
        let sizes = self.sizes(recipe);
        let mut frames = Vec::new();
        for index in 0..self.frames.len() {
            let frame = self.frame(index, recipe, None);
            let color = |channel: usize| Plane::F32(frame.color.pixels().iter().map(|c| c[channel]).collect());
            let motion = |axis: usize| {
                let vectors = frame.motion_px.as_ref().map(Image::pixels).unwrap_or_default();
                Plane::F32(vectors.iter().map(|m| m[axis]).collect())
            };
            let channels = [
                ("R", color(0)),
                ("G", color(1)),
                ("B", color(2)),
                ("motion.X", motion(0)),
                ("motion.Y", motion(1)),
                (
                    "depth",
                    Plane::F32(frame.depth.map(Image::into_pixels).unwrap_or_default()),
                ),
                (
                    "id",
                    Plane::U32(frame.object_id.map(Image::into_pixels).unwrap_or_default()),
                ),
            ];
            let path = folder.join(format!("{index:02}.exr"));
            write_exr(&path, sizes.render, &channels, FloatFormat::Float, Compression::ZIP16)?;
            frames.push(json!({"index": index, "jitter": frame.jitter_px, "reset": index == 0 || frame.reset}));
        }
        let file = "{index:02}.exr";
        let mut manifest = json!({
            "schema": "afterimage-sequence/1", "name": name, "license": "CC0-1.0", "fps": 60, "warmup_frames": 0,
            "render_size": sizes.render, "output_size": sizes.output, "frames": frames,
            "display": {"exposure": 1.0, "tonemap": "reinhard_max"},
            "jitter": {"meaning": "sample_offset", "units": "pixels_render", "y": "down"},
            "color": {"channels": ["R", "G", "B"], "path": file, "transfer": "linear"},
            "albedo": {"channels": ["R", "G", "B"], "path": file, "transfer": "linear"},
            "depth": {"channel": "depth", "kind": "linear_view_z", "path": file},
            "motion": {"channels": ["motion.X", "motion.Y"], "direction": "current_to_previous", "path": file,
                       "units": "pixels_render", "y": "down"},
            "object_id": {"channel": "id", "path": file},
        });
        if recipe.fills_checkerboard() {
            manifest["checkerboard"] = json!({"parity": [0, 1]});
        }
        let path = folder.join("manifest.json");
        fs::write(&path, format!("{manifest:#}\n")).map_err(at(&path))
    }
}

fn distance(a: [f64; 3], b: [f64; 3]) -> f64 {
    let of_channels = a.iter().zip(b).map(|(a, b)| (a - b).abs());
    of_channels.fold(
        0.0,
        |largest, d| if d.is_nan() { f64::INFINITY } else { largest.max(d) },
    )
}
