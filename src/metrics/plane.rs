//! Planes of f64, and the memory behind them, which goes from frame to frame: a new page costs as much as what metrics
//! compute on it.

use std::{
    collections::BTreeMap,
    ops::{Deref, DerefMut},
    sync::{Arc, Mutex, PoisonError},
};

/// Planes that nobody uses, by their size.
#[derive(Clone, Default)]
pub struct Pool(Arc<Mutex<BTreeMap<usize, Vec<Vec<f64>>>>>);

/// A number of values. Goes back to its pool in the end.
pub struct Plane {
    values: Vec<f64>,
    pool: Pool,
}

impl Pool {
    /// A plane of `n` values, whatever they are.
    pub fn plane(&self, n: usize) -> Plane {
        let mut values = self.spare(|spare| spare.get_mut(&n)?.pop()).unwrap_or_default();
        // Not `vec!`, which leaves new pages to whichever threads come upon them, and those get into each other's way.
        values.resize(n, 0.0);
        Plane {
            values,
            pool: self.clone(),
        }
    }

    fn spare<R>(&self, f: impl FnOnce(&mut BTreeMap<usize, Vec<Vec<f64>>>) -> R) -> R {
        f(&mut self.0.lock().unwrap_or_else(PoisonError::into_inner))
    }
}

impl Drop for Plane {
    fn drop(&mut self) {
        let values = std::mem::take(&mut self.values);
        self.pool
            .spare(|spare| spare.entry(values.len()).or_default().push(values));
    }
}

impl Deref for Plane {
    type Target = [f64];

    fn deref(&self) -> &[f64] {
        &self.values
    }
}

impl DerefMut for Plane {
    fn deref_mut(&mut self) -> &mut [f64] {
        &mut self.values
    }
}
