//! `flip`, `flip.p95` and `hdr_flip`: what the eye sees of the reference and of each image under test, filtered on the
//! device, and the map of their differences, which stays there.

use super::{
    super::{
        flip::{Exposures, Filters, color},
        quantity::Quantity,
    },
    Recording, Setup,
    histogram::{CopiedHistogram, Histogram},
    reference::References,
    sums::{Copied, SumPass, storage},
};
use crate::gpu::{GpuError, Invocation, Pass, Texture, UniformValue};
use wgpu::{BufferUsages, TextureFormat};

const POWERS: &str = include_str!("../../../shaders/metrics/powers.wgsl");
const ROOTS: &str = include_str!("../../../shaders/common/roots.wgsl");
const COLOR: &str = include_str!("../../../shaders/metrics/flip/color.wgsl");
const DISPLAYED: &str = include_str!("../../../shaders/metrics/flip/displayed.wgsl");
const EXPOSED: &str = include_str!("../../../shaders/metrics/flip/exposed.wgsl");
const FILTERS: &str = include_str!("../../../shaders/metrics/flip/filters.wgsl");
const ROWS: &str = include_str!("../../../shaders/metrics/flip/rows.wgsl");
const SEE: &str = include_str!("../../../shaders/metrics/flip/see.wgsl");
const DIFFER: &str = include_str!("../../../shaders/metrics/flip/differ.wgsl");
const MAP_SUM: &str = include_str!("../../../shaders/metrics/flip/map_sum.wgsl");

/// The passes, and room for what they leave each other.
#[derive(Debug)]
pub struct Flip {
    displayed: Option<Displayed>,
    exposed: Option<Exposed>,
    eye: Eye,
    differ: Pass,
    reference: Seen,
    test: Seen,
}

/// What FLIP of displayed images has of its own.
#[derive(Debug)]
struct Displayed {
    pass: Pass,
    map: wgpu::Buffer,
    mean: Option<SumPass<1>>,
    histogram: Option<Histogram>,
}

/// What HDR-FLIP has of its own.
#[derive(Debug)]
struct Exposed {
    pass: Pass,
    /// Of each preset: they take turns at every exposure.
    maps: Vec<wgpu::Buffer>,
    mean: SumPass<1>,
}

/// FLIP's filters.
#[derive(Debug)]
struct Eye {
    rows: Pass,
    see: Pass,
    taps: wgpu::Buffer,
    colors: [(&'static str, UniformValue); 7],
    opponent: Texture,
    color_rows: Texture,
    feature_rows: Texture,
}

/// What the eye sees of an image.
#[derive(Debug)]
struct Seen {
    colors_and_edges: Texture,
    points: Texture,
}

/// One preset's frame on its way back.
#[derive(Debug, Default)]
pub struct FlipSums {
    pub mean: Option<Copied<1>>,
    pub histogram: Option<CopiedHistogram>,
}

impl Flip {
    pub fn new(setup: &Setup, n_presets: usize) -> Result<Self, GpuError> {
        let is_displayed = setup.wants(Quantity::Flip) || setup.wants(Quantity::FlipPercentile);
        let is_exposed = setup.wants(Quantity::HdrFlip);
        Ok(Self {
            displayed: is_displayed.then(|| Displayed::new(setup)).transpose()?,
            exposed: is_exposed.then(|| Exposed::new(setup, n_presets)).transpose()?,
            eye: Eye::new(setup)?,
            differ: color_pass(setup, "metrics: flip, difference", DIFFER)?,
            reference: Seen::new(setup)?,
            test: Seen::new(setup)?,
        })
    }

    /// Records what the eye sees of the frame's reference.
    pub fn prepare(&self, recording: &mut Recording, references: &References) -> Result<(), GpuError> {
        let Some(displayed) = &self.displayed else {
            return Ok(());
        };
        let conversion = displayed.pass.bind("shown", references.shown());
        self.eye.see(recording, conversion, &self.reference)
    }

    /// Records FLIP of a displayed image.
    pub fn record(
        &self,
        recording: &mut Recording,
        references: &References,
        test_shown: &Texture,
    ) -> Result<FlipSums, GpuError> {
        let Some(Displayed {
            pass,
            map,
            mean,
            histogram,
        }) = &self.displayed
        else {
            return Ok(FlipSums::default());
        };
        self.eye.see(recording, pass.bind("shown", test_shown), &self.test)?;
        recording.encoder.clear_buffer(map, 0, None);
        self.differ(recording, map)?;
        let mean = mean.as_ref().map(|mean| sum(mean, recording, references, map));
        let histogram = histogram.as_ref().map(|of| of.record(recording, references, map));
        Ok(FlipSums {
            mean: mean.transpose()?,
            histogram: histogram.transpose()?,
        })
    }

    /// Records HDR-FLIP of every preset's linear image, where it is asked for. At each exposure the reference is seen once,
    /// and what was seen of it as displayed is lost.
    pub fn record_hdr(
        &self,
        recording: &mut Recording,
        references: &References,
        tests: &[&Texture],
        exposures: impl FnOnce() -> Exposures,
    ) -> Result<Vec<(Exposures, Copied<1>)>, GpuError> {
        let Some(Exposed { pass, maps, mean }) = &self.exposed else {
            return Ok(Vec::new());
        };
        let exposures = exposures();
        maps.iter().for_each(|map| recording.encoder.clear_buffer(map, 0, None));
        for factor in exposures.factors() {
            let expose = |linear| {
                pass.bind("linear", linear)
                    .uniform("exposure", &[("factor", factor.into())])
            };
            self.eye.see(recording, expose(&references.linear), &self.reference)?;
            for (test, map) in tests.iter().zip(maps) {
                self.eye.see(recording, expose(test), &self.test)?;
                self.differ(recording, map)?;
            }
        }
        let maps = tests.iter().zip(maps);
        maps.map(|(_, map)| Ok((exposures, sum(mean, recording, references, map)?)))
            .collect()
    }

    /// Brings a map up to what the eye has just seen of both images.
    fn differ(&self, recording: &mut Recording, map: &wgpu::Buffer) -> Result<(), GpuError> {
        let invocation = self
            .differ
            .bind("reference_seen", &self.reference.colors_and_edges)
            .bind("reference_points", &self.reference.points)
            .bind("test_seen", &self.test.colors_and_edges)
            .bind("test_points", &self.test.points)
            .bind("map", map)
            .uniform("colors", &self.eye.colors);
        recording.dispatch(invocation, self.test.points.extent())
    }
}

impl Displayed {
    fn new(setup: &Setup) -> Result<Self, GpuError> {
        let [mean, percentile] = [Quantity::Flip, Quantity::FlipPercentile].map(|quantity| setup.wants(quantity));
        Ok(Self {
            pass: color_pass(setup, "metrics: flip, displayed", DISPLAYED)?,
            map: new_map(setup)?,
            mean: mean.then(|| mean_pass(setup)).transpose()?,
            histogram: percentile.then(|| Histogram::new(setup)).transpose()?,
        })
    }
}

impl Exposed {
    fn new(setup: &Setup, n_presets: usize) -> Result<Self, GpuError> {
        Ok(Self {
            pass: color_pass(setup, "metrics: flip, exposed", EXPOSED)?,
            maps: (0..n_presets).map(|_| new_map(setup)).collect::<Result<_, _>>()?,
            mean: mean_pass(setup)?,
        })
    }
}

fn new_map(setup: &Setup) -> Result<wgpu::Buffer, GpuError> {
    let size = setup.extent.n_pixels() * size_of::<f32>();
    storage(setup.gpu, "a map of FLIP", size, BufferUsages::COPY_DST)
}

fn mean_pass(setup: &Setup) -> Result<SumPass<1>, GpuError> {
    SumPass::new(setup, "metrics: flip, mean", MAP_SUM, &[], &[])
}

fn color_pass(setup: &Setup, label: &str, shader: &str) -> Result<Pass, GpuError> {
    Pass::new(setup.gpu, label, &[shader, COLOR, POWERS, ROOTS], &spread())
}

fn sum(
    mean: &SumPass<1>,
    recording: &mut Recording,
    references: &References,
    map: &wgpu::Buffer,
) -> Result<Copied<1>, GpuError> {
    let invocation = mean.start(references.classes.as_ref()).bind("map", map);
    mean.record(recording, invocation)
}

/// How colour differences are spread over 0 to 1.
fn spread() -> [(&'static str, f64); 3] {
    [
        ("difference_exponent", f64::from(color::QC)),
        ("knee_at", f64::from(color::PC)),
        ("knee_to", f64::from(color::PT)),
    ]
}

impl Eye {
    fn new(setup: &Setup) -> Result<Self, GpuError> {
        let filters = Filters::new();
        let taps: Vec<u8> = bytemuck::pod_collect_to_vec(&filters.taps());
        let buffer = storage(setup.gpu, "FLIP's filters", taps.len(), BufferUsages::COPY_DST)?;
        setup.gpu.queue.write_buffer(&buffer, 0, &taps);
        let [wide, narrow] = filters.shares.map(f64::from);
        let shares = [("wide_share", wide), ("narrow_share", narrow)];
        let texture = |label| setup.texture(label, TextureFormat::Rgba32Float);
        let color::Colors {
            to_xyz: [x, y, z],
            from_xyz: [r, g, b],
            largest,
        } = color::Colors::new();
        Ok(Self {
            rows: Pass::new(setup.gpu, "metrics: flip, rows", &[ROWS, FILTERS], &[])?,
            see: Pass::new(
                setup.gpu,
                "metrics: flip, columns",
                &[SEE, FILTERS, COLOR, POWERS, ROOTS],
                &[&shares[..], &spread()].concat(),
            )?,
            taps: buffer,
            colors: [
                ("to_x", x.into()),
                ("to_y", y.into()),
                ("to_z", z.into()),
                ("from_r", r.into()),
                ("from_g", g.into()),
                ("from_b", b.into()),
                ("largest", largest.into()),
            ],
            opponent: texture("FLIP's opponent colours")?,
            color_rows: texture("FLIP's filtered rows")?,
            feature_rows: texture("FLIP's features along rows")?,
        })
    }

    /// Records what the eye sees of the image whose conversion to opponent colours is bound already.
    fn see<'a>(&'a self, recording: &mut Recording, conversion: Invocation<'a>, seen: &Seen) -> Result<(), GpuError> {
        let extent = self.opponent.extent();
        let conversion = conversion
            .bind("opponent", &self.opponent)
            .uniform("colors", &self.colors);
        recording.dispatch(conversion, extent)?;
        let rows = self
            .rows
            .bind("opponent", &self.opponent)
            .bind("taps", &self.taps)
            .bind("color_rows", &self.color_rows)
            .bind("feature_rows", &self.feature_rows);
        recording.dispatch(rows, extent)?;
        let see = self
            .see
            .bind("color_rows", &self.color_rows)
            .bind("feature_rows", &self.feature_rows)
            .bind("taps", &self.taps)
            .bind("seen", &seen.colors_and_edges)
            .bind("seen_points", &seen.points)
            .uniform("colors", &self.colors);
        recording.dispatch(see, extent)
    }
}

impl Seen {
    fn new(setup: &Setup) -> Result<Self, GpuError> {
        Ok(Self {
            colors_and_edges: setup.texture("seen colours and edges", TextureFormat::Rgba32Float)?,
            points: setup.texture("seen points", TextureFormat::R32Float)?,
        })
    }
}
