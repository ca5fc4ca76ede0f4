//! What some filters make of history before they sample it.

use super::{
    Builder,
    chain::{self, COMPENSATION, Chain},
    quasi_cubic::Coefficients,
};
use crate::{
    gpu::{GpuError, Texture},
    taa::{inputs::View, recipe::HistoryFilter, recorder::Recorder},
};

/// The passes over history.
#[derive(Debug)]
pub enum Prefilter {
    Bfecc(Chain),
    QuasiCubic(Coefficients),
}

impl Prefilter {
    /// The names of the passes, in the order recorded.
    pub fn passes(filter: HistoryFilter) -> Vec<&'static str> {
        match filter {
            HistoryFilter::Bfecc => chain::names(COMPENSATION).to_vec(),
            HistoryFilter::QuasiCubic => Coefficients::PASSES.to_vec(),
            _ => Vec::new(),
        }
    }

    /// None where the recipe samples history as it is.
    pub fn new(builder: Builder<'_>) -> Result<Option<Self>, GpuError> {
        Ok(match builder.recipe.history_filter {
            HistoryFilter::Bfecc => Some(Self::Bfecc(Chain::new(builder, COMPENSATION, builder.sizes.output)?)),
            HistoryFilter::QuasiCubic => Some(Self::QuasiCubic(Coefficients::new(builder)?)),
            _ => None,
        })
    }

    pub fn record(&self, recorder: &mut Recorder<'_>, view: View<'_>, history: &Texture) -> Result<(), GpuError> {
        match self {
            Self::Bfecc(compensation) => compensation.record(recorder, view, &[("history", history)]),
            Self::QuasiCubic(coefficients) => coefficients.record(recorder, view, history),
        }
    }

    /// What the filter samples.
    pub fn prefiltered(&self) -> &Texture {
        match self {
            Self::Bfecc(compensation) => compensation.made(),
            Self::QuasiCubic(coefficients) => coefficients.coefficients(),
        }
    }
}
