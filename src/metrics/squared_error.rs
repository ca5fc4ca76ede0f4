//! Everything that follows from Σ(T−R)² and ΣR²: `mse`, `rmse`, the `psnr` family and `snr`.

use super::{
    Better, MetricInfo,
    metric::Definition,
    quantity::{Domain, Quantity, Sums},
};

pub(super) const MSE: Definition = Definition {
    info: MetricInfo {
        id: "mse",
        unit: "",
        better: Better::Lower,
        version: 1,
        description: "Mean squared error of display RGB",
    },
    quantity: Quantity::SquaredError(Domain::Display),
    value: |sums| Some(sums.mean()),
    relative_mse: None,
};

pub(super) const RMSE: Definition = Definition {
    info: MetricInfo {
        id: "rmse",
        unit: "",
        better: Better::Lower,
        version: 1,
        description: "Root mean squared error of display RGB",
    },
    quantity: Quantity::SquaredError(Domain::Display),
    value: |sums| Some(sums.mean().sqrt()),
    relative_mse: None,
};

pub(super) const PSNR: Definition = psnr(
    "psnr",
    Domain::Display,
    |sums| Some(psnr_db(sums.mean(), Domain::Display.peak())),
    "Peak signal-to-noise ratio of display RGB",
);

pub(super) const PSNR_LINEAR: Definition = psnr(
    "psnr.linear",
    Domain::Linear,
    |sums| Some(psnr_db(sums.mean(), Domain::Linear.peak())),
    "Peak signal-to-noise ratio of linear RGB before the display transform, peak 1",
);

pub(super) const PSNR_U8: Definition = psnr(
    "psnr.u8",
    Domain::U8,
    |sums| Some(psnr_db(sums.mean(), Domain::U8.peak())),
    "Peak signal-to-noise ratio of display RGB rounded to 8 bits",
);

pub(super) const PSNR_Y: Definition = psnr(
    "psnr.y",
    Domain::Luma,
    |sums| Some(psnr_db(sums.mean(), Domain::Luma.peak())),
    "Peak signal-to-noise ratio of Rec. 709 luma",
);

pub(super) const SNR: Definition = Definition {
    info: MetricInfo {
        id: "snr",
        unit: "dB",
        better: Better::Higher,
        version: 1,
        description: "Reference energy over error energy of display RGB",
    },
    quantity: Quantity::SquaredError(Domain::Display),
    value: |sums| Some(snr_db(sums)),
    relative_mse: None,
};

const fn psnr(
    id: &'static str,
    domain: Domain,
    value: fn(&Sums) -> Option<f64>,
    description: &'static str,
) -> Definition {
    Definition {
        info: MetricInfo {
            id,
            unit: "dB",
            better: Better::Higher,
            version: 1,
            description,
        },
        quantity: Quantity::SquaredError(domain),
        value,
        relative_mse: Some(relative_mse),
    }
}

/// 10·log10(peak² / mse); +∞ for equal images.
pub(super) fn psnr_db(mse: f64, peak: f64) -> f64 {
    10.0 * libm::log10(peak * peak / mse)
}

/// The mean squared error over peak² of a PSNR.
pub(super) fn relative_mse(psnr_db: f64) -> f64 {
    libm::pow(10.0, -0.1 * psnr_db)
}

fn snr_db(sums: &Sums) -> f64 {
    let [error, energy, ..] = sums.terms;
    if error == 0.0 {
        return f64::INFINITY; // Equal images, black ones (0 / 0) too.
    }
    10.0 * libm::log10(energy / error)
}

#[cfg(test)]
mod tests {
    use crate::{
        image::{Extent, Image},
        metrics::{Metric, Picture, Reference},
    };

    fn scores(reference: [u16; 3], test: [u16; 3]) -> impl Fn(Metric) -> f64 {
        let picture = |codes: [u16; 3]| Picture::codes(Image::filled(Extent::new(37, 3), codes), 255);
        let scores = Reference::new(picture(reference), &Metric::ALL[..7]).evaluate(&picture(test));
        let scores = scores.unwrap();
        move |metric| scores.values[metric.id()].0
    }

    #[test]
    fn constant_images_by_hand() {
        let score = scores([51, 102, 0], [51, 153, 0]);
        let near = |metric: Metric, expected: f64| {
            let actual = score(metric);
            assert!(
                (actual - expected).abs() < 1e-12 * expected.abs(),
                "{metric}: {actual}, not {expected}"
            );
        };
        near(Metric::MSE, 0.04 / 3.0);
        near(Metric::RMSE, (0.04_f64 / 3.0).sqrt());
        near(Metric::PSNR, 10.0 * libm::log10(75.0));
        near(Metric::PSNR_U8, 10.0 * libm::log10(75.0));
        near(Metric::PSNR_Y, -20.0 * libm::log10(0.2 * 0.7152));
        near(Metric::SNR, 10.0 * libm::log10((0.04 + 0.16) / 0.04));
    }

    /// Where nothing else is asked for, errors of 8-bit images are added up as integers.
    #[test]
    fn integers_and_what_they_show_have_the_same_errors() {
        let picture = |factor: u32| {
            let code = move |x: u32, y: u32, channel: u32| (((x + 300 * y) * factor + 91 * channel) % 256) as u16;
            Picture::codes(
                Image::from_fn(Extent::new(301, 70), |x, y| {
                    [0, 1, 2].map(|channel| code(x, y, channel))
                }),
                255,
            )
        };
        let errors = |metrics: &[Metric]| {
            let scores = Reference::new(picture(7), metrics).evaluate(&picture(11)).unwrap();
            [Metric::MSE, Metric::PSNR_U8].map(|metric| scores.values[metric.id()].0)
        };
        let exact = errors(&[Metric::MSE, Metric::PSNR_U8]);
        let shown = errors(&[Metric::MSE, Metric::PSNR_U8, Metric::PSNR_Y]);
        for (exact, shown) in exact.into_iter().zip(shown) {
            assert!((exact / shown - 1.0).abs() < 1e-13, "{exact}, not {shown}");
        }
        assert!(exact[0] > 0.01, "{exact:?}");
    }

    #[test]
    fn black_against_black_is_perfect_and_black_against_white_is_not() {
        let equal = scores([0; 3], [0; 3]);
        assert_eq!([equal(Metric::SNR), equal(Metric::PSNR)], [f64::INFINITY; 2]);
        let worst = scores([0; 3], [255; 3]);
        assert_eq!([worst(Metric::SNR), worst(Metric::PSNR)], [f64::NEG_INFINITY, 0.0]);
    }
}
