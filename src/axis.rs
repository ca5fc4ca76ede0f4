//! Axes of charts, with round numbers on them.

/// From values to 0 at the low end and 1 at the high end.
#[derive(Clone, Debug)]
pub struct Axis {
    low: f64,
    high: f64,
    is_log: bool,
    ticks: Vec<f64>,
}

impl Axis {
    /// Linear, ending at round numbers. Not finite values are left out.
    pub fn linear(values: impl Iterator<Item = f64>) -> Self {
        let (low, high) = match range(values) {
            Some((low, high)) if low < high => (low, high),
            Some((low, _)) => (low - 0.5, low + 0.5),
            None => (0.0, 1.0),
        };
        let rough = (high - low) / 5.0;
        let power = libm::pow(10.0, libm::log10(rough).floor());
        let step = [1.0, 2.0, 5.0, 10.0]
            .into_iter()
            .map(|factor| factor * power)
            .find(|step| *step >= rough)
            .unwrap_or(rough);
        let (first, last) = ((low / step).floor(), (high / step).ceil());
        let n = (last - first).round() as usize;
        Self {
            low: first * step,
            high: last * step,
            is_log: false,
            ticks: (0..=n).map(|index| rounded((first + index as f64) * step)).collect(),
        }
    }

    /// Logarithmic, with 1, 2 and 5 times the powers of ten on it. For values above 0.
    pub fn powers(values: impl Iterator<Item = f64>) -> Self {
        let (low, high) = range(values.map(|value| value.max(1e-6))).unwrap_or((1.0, 10.0));
        let (low, high) = (low / 1.2, high * 1.2);
        let first = libm::floor(libm::log10(low)) as i32;
        let last = libm::ceil(libm::log10(high)) as i32;
        let ticks = (first..=last)
            .flat_map(|power| [1.0, 2.0, 5.0].map(|digit| rounded(digit * libm::pow(10.0, f64::from(power)))))
            .filter(|tick| (low..=high).contains(tick))
            .collect();
        Self {
            low: libm::log10(low),
            high: libm::log10(high),
            is_log: true,
            ticks,
        }
    }

    /// Where a value is.
    pub fn place(&self, value: f64) -> f64 {
        let value = if self.is_log {
            libm::log10(value.max(1e-6))
        } else {
            value
        };
        (value - self.low) / (self.high - self.low)
    }

    /// The round numbers, ascending.
    pub fn ticks(&self) -> &[f64] {
        &self.ticks
    }
}

/// Without the digits that a product of powers of ten leaves behind.
fn rounded(value: f64) -> f64 {
    format!("{value:.9e}").parse().expect("a printed number")
}

fn range(values: impl Iterator<Item = f64>) -> Option<(f64, f64)> {
    values.filter(|value| value.is_finite()).fold(None, |range, value| {
        let (low, high) = range.unwrap_or((value, value));
        Some((value.min(low), value.max(high)))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn linear_axes_end_at_round_numbers() {
        let axis = Axis::linear([21.3, 28.9].into_iter());
        assert_eq!(axis.ticks(), [20.0, 22.0, 24.0, 26.0, 28.0, 30.0]);
        assert_eq!(axis.place(25.0), 0.5);
        assert_eq!(Axis::linear([0.0, 0.7].into_iter()).ticks().last(), Some(&0.8));
        let flat = Axis::linear([5.0, f64::INFINITY, 5.0].into_iter());
        assert!((flat.place(5.0) - 0.5).abs() < 1e-9, "{flat:?}");
        assert_eq!(flat.ticks().first(), Some(&4.4));
        assert_eq!(Axis::linear(std::iter::empty()).ticks().len(), 6);
    }

    #[test]
    fn logarithmic_axes_hold_their_values() {
        let axis = Axis::powers([0.9, 30.0].into_iter());
        assert_eq!(axis.ticks(), [1.0, 2.0, 5.0, 10.0, 20.0]);
        assert!(axis.place(0.9) > 0.0 && axis.place(30.0) < 1.0);
    }
}
