//! Everything that follows from Σ(T−R)² and ΣR²: `mse`, `rmse`, the `psnr` family and `snr`.

use super::{Better, Definition, Domain, MetricInfo, Quantity, Shown, Sums};
use rayon::prelude::*;

pub(super) const MSE: Definition = Definition {
    info: MetricInfo {
        id: "mse",
        unit: "",
        better: Better::Lower,
        version: 1,
        description: "Mean squared error of display RGB",
    },
    quantity: Quantity::SquaredError(Domain::Display),
    value: Sums::mean,
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
    value: |sums| sums.mean().sqrt(),
    relative_mse: None,
};

pub(super) const PSNR: Definition = psnr(
    "psnr",
    Domain::Display,
    |sums| psnr_db(sums.mean(), Domain::Display.peak()),
    "Peak signal-to-noise ratio of display RGB",
);

pub(super) const PSNR_LINEAR: Definition = psnr(
    "psnr.linear",
    Domain::Linear,
    |sums| psnr_db(sums.mean(), Domain::Linear.peak()),
    "Peak signal-to-noise ratio of linear RGB before the display transform, peak 1",
);

pub(super) const PSNR_U8: Definition = psnr(
    "psnr.u8",
    Domain::U8,
    |sums| psnr_db(sums.mean(), Domain::U8.peak()),
    "Peak signal-to-noise ratio of display RGB rounded to 8 bits",
);

pub(super) const PSNR_Y: Definition = psnr(
    "psnr.y",
    Domain::Luma,
    |sums| psnr_db(sums.mean(), Domain::Luma.peak()),
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
    value: snr_db,
    relative_mse: None,
};

const fn psnr(id: &'static str, domain: Domain, value: fn(&Sums) -> f64, description: &'static str) -> Definition {
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
    if sums.total == 0.0 {
        return f64::INFINITY; // Equal images, black ones (0 / 0) too.
    }
    10.0 * libm::log10(sums.reference / sums.total)
}

pub(super) fn measure(domain: Domain, reference: &Shown, test: &Shown) -> Sums {
    sum_rows(domain, reference, test, row_sums)
}

/// Two sums of each row and channel of reference and test, then the rows from top to bottom, so that the
/// result does not depend on the number of threads.
pub(super) fn sum_rows(
    domain: Domain,
    reference: &Shown,
    test: &Shown,
    row_sums: impl Fn(&[f64], &[f64]) -> [f64; 2] + Sync,
) -> Sums {
    let extent = reference.extent();
    let columns = 0..extent.width as usize;
    let rows: Vec<[f64; 2]> = (0..extent.height as usize)
        .into_par_iter()
        .map_init(<[Vec<f64>; 2]>::default, |[scratch_r, scratch_t], y| {
            let mut row = [0.0; 2];
            for channel in 0..domain.n_channels() {
                let sums = row_sums(
                    reference.row(domain, channel, y, columns.clone(), scratch_r),
                    test.row(domain, channel, y, columns.clone(), scratch_t),
                );
                row = [row[0] + sums[0], row[1] + sums[1]];
            }
            row
        })
        .collect();
    Sums {
        total: rows.iter().map(|row| row[0]).sum(),
        reference: rows.iter().map(|row| row[1]).sum(),
        n: extent.n_pixels() * domain.n_channels(),
        ..Sums::default()
    }
}

/// Σ(T−R)² and ΣR² of a row, in eight interleaved partial sums: a single one would wait for its own last addition.
fn row_sums(reference: &[f64], test: &[f64]) -> [f64; 2] {
    const LANES: usize = 8;
    let (mut errors, mut energies) = ([0.0; LANES], [0.0; LANES]);
    for (r, t) in reference.chunks(LANES).zip(test.chunks(LANES)) {
        for (lane, (r, t)) in r.iter().zip(t).enumerate() {
            errors[lane] += (t - r) * (t - r);
            energies[lane] += r * r;
        }
    }
    [errors.iter().sum(), energies.iter().sum()]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        image::{Extent, Image},
        metrics::{Metric, evaluate},
    };

    fn scores(reference: [f32; 3], test: [f32; 3]) -> impl Fn(Metric) -> f64 {
        let shown = |codes: [f32; 3]| {
            let image = Image::filled(Extent::new(37, 3), codes.map(|code| code / 255.0));
            Shown::from_encoded(&image, 255, &Metric::ALL[..7])
        };
        let scores = evaluate(&Metric::ALL[..7], &shown(reference), &shown(test)).unwrap();
        move |metric| scores.values[metric.id()].0
    }

    #[test]
    fn constant_images_by_hand() {
        let score = scores([51.0, 102.0, 0.0], [51.0, 153.0, 0.0]);
        let near = |metric: Metric, expected: f64| {
            let actual = score(metric);
            assert!(
                (actual - expected).abs() < 1e-12 * expected.abs(),
                "{metric}: {actual}, not {expected}"
            );
        };
        near(Metric::Mse, 0.04 / 3.0);
        near(Metric::Rmse, (0.04_f64 / 3.0).sqrt());
        near(Metric::Psnr, 10.0 * libm::log10(75.0));
        near(Metric::PsnrU8, 10.0 * libm::log10(75.0));
        near(Metric::PsnrY, -20.0 * libm::log10(0.2 * 0.7152));
        near(Metric::Snr, 10.0 * libm::log10((0.04 + 0.16) / 0.04));
    }

    #[test]
    fn black_against_black_is_perfect_and_black_against_white_is_not() {
        let equal = scores([0.0; 3], [0.0; 3]);
        assert_eq!([equal(Metric::Snr), equal(Metric::Psnr)], [f64::INFINITY; 2]);
        let worst = scores([0.0; 3], [255.0; 3]);
        assert_eq!([worst(Metric::Snr), worst(Metric::Psnr)], [f64::NEG_INFINITY, 0.0]);
    }
}
