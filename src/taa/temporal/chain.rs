//! Passes in a row, each of which makes one image that the next may read; what follows reads the last.

use super::Builder;
use crate::{
    gpu::{GpuError, Pass, Texture},
    image::Extent,
    taa::{inputs::View, recorder::Recorder},
};

/// What a chain is made of.
#[derive(Clone, Copy, Debug)]
pub struct Link {
    /// The pass's name in reports.
    pub pass: &'static str,
    /// Its WGSL.
    pub text: &'static str,
    /// The image it makes, as its shader and the next one's bind it.
    pub image: &'static str,
}

/// History prepared so that sampling it bilinearly loses little: for the filter `bfecc`.
pub const COMPENSATION: [Link; 2] = [
    Link {
        pass: "advect",
        text: include_str!("../../../shaders/taa/temporal/advect.wgsl"),
        image: "advected",
    },
    Link {
        pass: "compensate",
        text: include_str!("../../../shaders/taa/temporal/compensate.wgsl"),
        image: "next_compensated",
    },
];

/// How far history is from the current colour, and its means over rows of 7 texels: what the weight `amortized` looks at.
pub const DIFFERENCE: [Link; 2] = [
    Link {
        pass: "difference",
        text: include_str!("../../../shaders/taa/temporal/difference.wgsl"),
        image: "difference",
    },
    Link {
        pass: "difference_rows",
        text: include_str!("../../../shaders/taa/temporal/difference_rows.wgsl"),
        image: "rows",
    },
];

/// The passes, and an image each.
#[derive(Debug)]
pub struct Chain {
    extent: Extent,
    links: [(&'static str, Pass, Texture); 2],
}

impl Chain {
    /// Makes images of `extent`.
    pub fn new(builder: Builder<'_>, links: [Link; 2], extent: Extent) -> Result<Self, GpuError> {
        let [first, second] = links.map(|link| {
            let pass = builder.pass(link.pass, link.text, &[])?;
            let image = builder
                .gpu
                .scope("making room between passes", || builder.color(link.image, extent))?;
            Ok((link.image, pass, image))
        });
        Ok(Self {
            extent,
            links: [first?, second?],
        })
    }

    /// Records the passes, which may read `shared`.
    pub fn record(
        &self,
        recorder: &mut Recorder<'_>,
        view: View<'_>,
        shared: &[(&'static str, &Texture)],
    ) -> Result<(), GpuError> {
        let mut before = shared.to_vec();
        for (name, pass, image) in &self.links {
            let readable = view.bind_to(pass);
            let readable = before
                .iter()
                .fold(readable, |bound, &(name, read)| bound.offer(name, read));
            let dispatch = readable.bind(name, image).over(recorder.gpu, self.extent)?;
            recorder.record(&dispatch)?;
            before.push((name, image));
        }
        Ok(())
    }

    /// What the last pass made.
    pub fn made(&self) -> &Texture {
        &self.links[1].2
    }
}

/// The passes' names, in their order.
pub fn names(links: [Link; 2]) -> [&'static str; 2] {
    links.map(|link| link.pass)
}
