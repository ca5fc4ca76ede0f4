//! The recipe pass by pass: what each writes, under the names of its shader, and where that goes. A pass of a new system has
//! a line in both tables.

use super::{
    Pixels, Twin, color,
    color::{Color, Repaired},
    fxaa, merge,
    planes::{Left, Moments, Plane, Scale, made},
    quasi_cubic,
    real::Real,
    smaa,
    sobel2018::Scalars,
    spatial::Light,
};
use crate::{
    image::Image,
    sequence::Frame,
    taa::{
        Precision, Source,
        recipe::{Algorithm, Sharpen},
    },
};

impl<R: Real> Twin<R> {
    /// The names of the passes in their order: `merge` where pixels have several samples or layers, `prepare`, and those of
    /// [`crate::taa::Recipe::passes`].
    pub fn passes(&self, frame: &Frame) -> Vec<&'static str> {
        let merges = frame.others.as_ref().map(|_| "merge");
        let before = merges.into_iter().chain(["prepare"]);
        before.chain(self.recipe.passes()).collect()
    }

    /// What `pass` writes, from what the passes before it and the frame before left. Nothing where it would only look at a
    /// history that is absent.
    ///
    /// # Panics
    /// Where there is no such pass, or one before it has not been kept.
    pub fn compute(&self, pass: &str, frame: &Frame) -> Vec<Plane<R>> {
        match pass {
            "merge" => return self.merge(frame),
            "prepare" => return self.prepare(frame),
            _ => {}
        }
        let pixels = self.pixels(frame);
        let scale = Scale::of(self.recipe.domain);
        let colors = |name, image: Option<Image<Color<R>>>| {
            let plane = image.map(|image| Plane::colors(name, scale, &image));
            plane.into_iter().collect()
        };
        let light = Light::of(&self.recipe);
        match (self.recipe.algorithm, pass) {
            (_, "fxaa") => colors("antialiased", Some(fxaa::antialiased(pixels.color, light))),
            (_, "smaa_edges") => {
                let edges = smaa::edges(pixels.color);
                vec![Plane::new("next_edges", [Scale::Range], &edges, |sides| {
                    [R::new(sides.bits() as f64)]
                })]
            }
            (_, "smaa_weights") => {
                let weights = smaa::weights(made(&self.planes.smaa_edges));
                vec![Plane::new(
                    "next_weights",
                    [Scale::Range; 4],
                    &weights,
                    |[[a, b], [c, d]]| [a, b, c, d],
                )]
            }
            (_, "smaa_blend") => {
                let weights = made(&self.planes.smaa_weights);
                colors("antialiased", Some(smaa::blend(pixels.color, weights, light)))
            }
            (Algorithm::Phlm2016, "still") => vec![Plane::number("moves", u64::from(!pixels.nothing_moves()))],
            (Algorithm::Phlm2016, "model") => self.model(pixels.phlm(), frame),
            (Algorithm::Checkerboard, "resolve") => {
                let resolved = pixels.checkerboard();
                vec![self.next_history(&resolved), self.show(&resolved, frame)]
            }
            (_, "advect") => colors("advected", pixels.advected()),
            (_, "compensate") => colors("next_compensated", pixels.compensated()),
            (_, "prefilter_rows") => {
                let history = self.previous.as_ref().map(|previous| previous.history());
                colors("coefficients", history.map(quasi_cubic::along_rows))
            }
            (_, "prefilter_columns") => {
                let rows = self.planes.row_coefficients.as_ref();
                colors("coefficients", rows.map(quasi_cubic::along_columns))
            }
            (_, "difference") => colors("difference", pixels.difference()),
            (_, "difference_rows") => colors("rows", pixels.difference_rows()),
            (_, "moments_rows") => self.moments(&pixels.row_moments()),
            (_, "moments_columns") => self.moments(&pixels.window_moments()),
            (_, "edges") => vec![Plane::scalars("edges", &pixels.edges())],
            (_, "stabilise") => {
                let stable = pixels.stabilised();
                vec![
                    Plane::scalars("next_edge_history", &self.rounded(&stable)),
                    Plane::scalars("stabilised", &stable),
                ]
            }
            (_, "resolve") => self.temporal(&pixels),
            (_, "sharpen") => vec![self.show(&pixels.output(made(&self.planes.resolved)), frame)],
            (_, unknown) => unreachable!("`Recipe::passes` names no `{unknown}`"),
        }
    }

    /// Makes what a pass wrote, here or on the GPU, that which later passes and the next frame read.
    pub fn keep(&mut self, pass: &str, plane: &Plane<R>) {
        let planes = &mut self.planes;
        let left = &mut planes.left;
        match (pass, plane.name) {
            (_, "merged_color") => {
                planes.merged = Some(Repaired {
                    color: plane.to_colors(),
                    hostile: plane.image(|c| c[3] == R::new(0.0)),
                });
            }
            (_, "merged_motion") => {
                planes.merged_motion_px = Some(plane.image(|c| [c[0], c[1]].map(|px| px.to_f64() as f32)));
            }
            (_, "merged_depth") => self.images.depth = Some(plane.image(|c| c[0].to_f64() as f32)),
            ("prepare", "color") => {
                planes.color = Some(plane.to_colors());
                planes.unlit_luma = (plane.scales.len() == 4).then(|| plane.image(|c| c[3]));
            }
            ("prepare", "repaired_texels") => planes.repaired_texels = plane.values[0].to_f64() as u64,
            (_, "next_edges") => {
                planes.smaa_edges = Some(plane.image(|c| smaa::Sides::from_bits(c[0].to_f64() as u64)));
            }
            (_, "next_weights") => planes.smaa_weights = Some(plane.image(|c| [[c[0], c[1]], [c[2], c[3]]])),
            (_, "antialiased") => planes.antialiased = Some(plane.to_colors()),
            (_, "advected") => planes.advected = Some(plane.to_colors()),
            (_, "next_compensated") => planes.compensated = Some(plane.to_colors()),
            ("prefilter_rows", "coefficients") => planes.row_coefficients = Some(plane.to_colors()),
            (_, "coefficients") => planes.coefficients = Some(plane.to_colors()),
            (_, "difference") => planes.difference = Some(plane.to_colors()),
            (_, "rows") => planes.difference_rows = Some(plane.to_colors()),
            ("moments_rows", "means") => planes.row_moments.means = Some(plane.to_colors()),
            ("moments_rows", "variances") => planes.row_moments.variances = Some(plane.to_colors()),
            (_, "means") => planes.window_moments.means = Some(plane.to_colors()),
            (_, "variances") => planes.window_moments.variances = Some(plane.to_colors()),
            (_, "edges") => planes.edges = Some(plane.to_scalars()),
            (_, "stabilised") => planes.stable_edges = Some(plane.to_scalars()),
            (_, "next_edge_history") => left.edge_history = Some(plane.to_scalars()),
            (_, "moves") => planes.moves = plane.values[0] > R::new(0.0),
            (_, "next_history") => left.history = Some(plane.to_colors()),
            (_, "next_n_samples") => left.n_samples = Some(plane.image(|c| c[0])),
            (_, "next_coefficients") => left.coefficients = Some(plane.image(coefficients)),
            (_, "next_covariances") => left.covariances = Some(plane.image(covariance)),
            (_, "next_mean") => left.mean = Some(plane.image(|c| (Color([c[0], c[1], c[2]]), c[3]))),
            ("resolve", "shown") if self.recipe.sharpen != Sharpen::None => planes.resolved = Some(plane.to_colors()),
            (_, "shown") => planes.shown = Some(plane.to_colors()),
            (pass, unknown) => unreachable!("`{pass}` writes no `{unknown}`"),
        }
    }

    fn merge(&self, frame: &Frame) -> Vec<Plane<R>> {
        let Repaired { color, hostile } = merge::color::<R>(frame);
        let both: Vec<_> = color.pixels().iter().zip(hostile.pixels()).collect();
        let both = Image::from_pixels(color.extent(), both);
        let scales = [Scale::Open, Scale::Open, Scale::Open, Scale::Range];
        let merged = Plane::new("merged_color", scales, &both, |(color, hostile)| {
            let [r, g, b] = color.0;
            [r, g, b, R::new(if *hostile { 0.0 } else { 1.0 })]
        });
        let read = self.recipe.required_channels();
        let motion = merge::motion_px(frame).filter(|_| read.motion);
        let depth = merge::depth(frame).filter(|_| read.depth);
        let motion = motion.map(|motion| {
            Plane::new("merged_motion", [Scale::Range; 2], &motion, |px| {
                px.map(|px| R::new(px.into()))
            })
        });
        let depth = depth.map(|depth| Plane::new("merged_depth", [Scale::Open], &depth, |z| [R::new(z.into())]));
        [merged].into_iter().chain(motion).chain(depth).collect()
    }

    fn prepare(&self, frame: &Frame) -> Vec<Plane<R>> {
        let recipe = &self.recipe;
        let repaired = match (recipe.source, &frame.unjittered_color, &self.planes.merged) {
            (Source::UnjitteredIfPresent, Some(unjittered), _) => color::repaired(unjittered, recipe.guards),
            (_, _, Some(merged)) => merged.clone(),
            _ => color::repaired(&frame.color, recipe.guards),
        };
        let albedo = frame.albedo.as_ref().filter(|_| recipe.optional_channels().albedo);
        let prepared = color::prepare(&repaired, albedo, recipe.domain, &frame.display, recipe.guards);
        let scale = Scale::of(recipe.domain);
        let color = if recipe.finds_edges() {
            let luma = prepared.unlit_luma.pixels();
            let both: Vec<_> = prepared.color.pixels().iter().zip(luma).collect();
            let both = Image::from_pixels(prepared.color.extent(), both);
            Plane::new("color", [scale; 4], &both, |(color, luma)| {
                let [r, g, b] = color.0;
                [r, g, b, *luma]
            })
        } else {
            Plane::colors("color", scale, &prepared.color)
        };
        vec![color, Plane::number("repaired_texels", prepared.repaired_texels)]
    }

    /// The temporal pass. Where sharpening follows, that shows what this has resolved.
    fn temporal(&self, pixels: &Pixels<'_, R>) -> Vec<Plane<R>> {
        let sampled = Image::from_fn(pixels.sizes.output, |x, y| pixels.resolve([x.into(), y.into()]));
        let resolved = sampled.map(|pixel| pixel.color);
        let mut written = Vec::new();
        if self.recipe.uses_history() {
            written.push(self.next_history(&resolved));
        }
        if self.recipe.weight.counts() {
            written.push(Plane::new("next_n_samples", [Scale::Count], &sampled, |pixel| {
                [pixel.n_samples]
            }));
        }
        written.push(match self.recipe.sharpen {
            Sharpen::None => self.show(&pixels.output(&resolved), pixels.frame),
            _ => Plane::colors("shown", Scale::of(self.recipe.domain), &resolved),
        });
        written
    }

    fn moments(&self, moments: &Moments<R>) -> Vec<Plane<R>> {
        let domain = self.recipe.domain;
        vec![
            Plane::colors("means", Scale::of(domain), made(&moments.means)),
            Plane::colors("variances", Scale::of_variance(domain), made(&moments.variances)),
        ]
    }

    fn model(&self, left: Left<R>, frame: &Frame) -> Vec<Plane<R>> {
        let mean = made(&left.mean);
        let shown = mean.map(|(shown, _)| shown);
        let scale = Scale::of(self.recipe.domain);
        vec![
            Plane::new("next_coefficients", [Scale::Open; 12], made(&left.coefficients), |c| {
                std::array::from_fn(|i| c[i % 4].0[i / 4])
            }),
            Plane::new("next_covariances", [Scale::Open; 10], made(&left.covariances), |p| {
                TRIANGLE.map(|[row, column]| p[row][column])
            }),
            self.next_history(made(&left.history)),
            Plane::new("next_mean", [scale, scale, scale, Scale::Count], mean, |(shown, n)| {
                let [r, g, b] = shown.0;
                [r, g, b, n]
            }),
            self.show(&shown, frame),
        ]
    }

    fn next_history(&self, resolved: &Image<Color<R>>) -> Plane<R> {
        Plane::colors("next_history", Scale::of(self.recipe.domain), &self.rounded(resolved))
    }

    /// As it is stored.
    fn rounded(&self, image: &Scalars<R>) -> Scalars<R> {
        match self.precision {
            Precision::F16 => image.map(|c| c.map(R::round_to_f16)),
            Precision::F32 => image.clone(),
        }
    }

    /// From the working domain.
    fn show(&self, resolved: &Image<Color<R>>, frame: &Frame) -> Plane<R> {
        let linear = resolved.map(|color| color.from_domain(self.recipe.domain, &frame.display));
        Plane::colors("shown", Scale::Open, &linear)
    }
}

/// One colour for each element of the vector, from a channel's four after another's.
fn coefficients<R: Real>(values: &[R]) -> [Color<R>; 4] {
    std::array::from_fn(|i| Color(std::array::from_fn(|channel| values[4 * channel + i])))
}

/// Where the GPU keeps what of a symmetric matrix (`Covariance` in `shaders/taa/phlm2016/model.wgsl`).
const TRIANGLE: [[usize; 2]; 10] = [
    [0, 0],
    [0, 1],
    [0, 2],
    [0, 3],
    [1, 1],
    [1, 2],
    [1, 3],
    [3, 3],
    [2, 2],
    [2, 3],
];

fn covariance<R: Real>(values: &[R]) -> [[R; 4]; 4] {
    let mut p = [[R::new(0.0); 4]; 4];
    for ([row, column], &value) in TRIANGLE.into_iter().zip(values) {
        p[row][column] = value;
        p[column][row] = value;
    }
    p
}
