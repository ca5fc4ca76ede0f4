//! Colours, colour spaces, the working domain and the repair of hostile texels: the twin of `shaders/common/color.wgsl`.

use super::{display, real::Real};
use crate::{
    image::Image,
    metrics::Display,
    sequence::frame::Rgb,
    taa::recipe::{Domain, Guards, Space},
};
use std::ops::{Add, Mul, Sub};

/// Three channels of some colour space.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Color<R>(pub [R; 3]);

/// The largest finite f16: nothing larger is ever stored.
pub const F16_MAX: f64 = 65504.0;

impl<R: Real> Color<R> {
    /// The same value in every channel.
    pub fn splat(value: f64) -> Self {
        Self([R::new(value); 3])
    }

    /// Applies `f` to each channel.
    pub fn map(self, f: impl Fn(R) -> R) -> Self {
        Self(self.0.map(f))
    }

    /// Combines channel by channel.
    pub fn zip(self, other: Self, f: impl Fn(R, R) -> R) -> Self {
        Self(std::array::from_fn(|i| f(self.0[i], other.0[i])))
    }

    /// Channel by channel.
    pub fn min(self, other: Self) -> Self {
        self.zip(other, R::min)
    }

    /// Channel by channel.
    pub fn max(self, other: Self) -> Self {
        self.zip(other, R::max)
    }

    /// Channel by channel.
    pub fn clamp(self, lo: Self, hi: Self) -> Self {
        self.max(lo).min(hi)
    }

    /// The largest channel.
    pub fn max3(self) -> R {
        self.0[0].max(self.0[1]).max(self.0[2])
    }

    /// Rec. 709 luma, of RGB.
    pub fn luma(self) -> R {
        let [r, g, b] = self.0;
        R::new(0.2126) * r + R::new(0.7152) * g + R::new(0.0722) * b
    }

    /// From RGB to `space`.
    pub fn to_space(self, space: Space) -> Self {
        let [r, g, b] = self.0;
        let (half, quarter) = (R::new(0.5), R::new(0.25));
        match space {
            Space::Rgb => self,
            Space::Ycocg => Self([
                quarter * r + half * g + quarter * b,
                half * r - half * b,
                -quarter * r + half * g - quarter * b,
            ]),
        }
    }

    /// From `space` back to RGB, which is not negative.
    pub fn from_space(self, space: Space) -> Self {
        let [y, co, cg] = self.0;
        match space {
            Space::Rgb => self,
            Space::Ycocg => Self([y + co - cg, y + cg, y - co - cg]).max(Self::splat(0.0)),
        }
    }

    /// Luma in `space`: its first channel where that is one.
    pub fn luma_in(self, space: Space) -> R {
        match space {
            Space::Rgb => self.luma(),
            Space::Ycocg => self.0[0],
        }
    }

    /// From linear to the domain that history lives in.
    pub fn to_domain(self, domain: Domain, display: &Display) -> Self {
        match domain {
            Domain::Linear => self,
            Domain::Tonemapped => display::reinhard_max(self),
            Domain::Display => display::shown(self, display),
        }
    }

    /// Back to linear.
    pub fn from_domain(self, domain: Domain, display: &Display) -> Self {
        match domain {
            Domain::Linear => self,
            Domain::Tonemapped => display::inverse_reinhard_max(self),
            Domain::Display => display::linear(self, display),
        }
    }

    /// `a (1 - t) + b t`.
    pub fn mix(a: Self, b: Self, t: R) -> Self {
        a * (R::new(1.0) - t) + b * t
    }
}

impl<R: Real> Add for Color<R> {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        self.zip(other, |a, b| a + b)
    }
}

impl<R: Real> Sub for Color<R> {
    type Output = Self;
    fn sub(self, other: Self) -> Self {
        self.zip(other, |a, b| a - b)
    }
}

impl<R: Real> Mul<R> for Color<R> {
    type Output = Self;
    fn mul(self, factor: R) -> Self {
        self.map(|channel| channel * factor)
    }
}

/// NaN, infinite, negative or above [`F16_MAX`]. `-0` is none of them.
pub fn is_hostile(x: f32) -> bool {
    !(x >= 0.0 && f64::from(x) <= F16_MAX)
}

/// NaN, negatives and -∞ become 0; +∞ and what is above [`F16_MAX`] become that.
fn repair(x: f32) -> f32 {
    if !is_hostile(x) {
        x
    } else if x > 0.0 {
        F16_MAX as f32
    } else {
        0.0
    }
}

/// A frame's colour, repaired and in its domain.
#[derive(Clone, Debug)]
pub struct Prepared<R> {
    /// In the working domain.
    pub color: Image<Color<R>>,
    /// Luma of the albedo; of the colour itself where there is none.
    pub unlit_luma: Image<R>,
    /// Texels whose colour or albedo needed repair.
    pub repaired_texels: u64,
}

/// A colour without hostile components.
#[derive(Clone, Debug)]
pub struct Repaired<R> {
    /// Linear.
    pub color: Image<Color<R>>,
    /// Where there was one.
    pub hostile: Image<bool>,
}

/// Each component, unless `guards` are off, and where that was needed.
pub fn repaired<R: Real>(image: &Image<Rgb>, guards: Guards) -> Repaired<R> {
    let taken = |channel| match guards {
        Guards::On => repair(channel),
        Guards::Off => channel,
    };
    Repaired {
        color: image.map(|rgb| Color(rgb.map(|channel| R::new(f64::from(taken(channel)))))),
        hostile: image.map(|rgb| rgb.into_iter().any(is_hostile)),
    }
}

/// Maps a frame's colour into `domain`, repairs its albedo where that is read, and counts the repaired texels of both.
pub fn prepare<R: Real>(
    color: &Repaired<R>,
    albedo: Option<&Image<Rgb>>,
    domain: Domain,
    display: &Display,
    guards: Guards,
) -> Prepared<R> {
    let albedo = albedo.map(|albedo| repaired::<R>(albedo, guards));
    let needed_repair = |i: &usize| {
        let albedo = albedo.as_ref().is_some_and(|albedo| albedo.hostile.pixels()[*i]);
        color.hostile.pixels()[*i] || albedo
    };
    let prepared = color.color.map(|linear| linear.to_domain(domain, display));
    Prepared {
        repaired_texels: (0..prepared.pixels().len()).filter(needed_repair).count() as u64,
        unlit_luma: match &albedo {
            Some(albedo) => albedo.color.map(Color::luma),
            None => prepared.map(Color::luma),
        },
        color: prepared,
    }
}
