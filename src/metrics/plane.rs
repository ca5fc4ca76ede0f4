//! Planes of f64, and the memory behind them, which goes from frame to frame: a new page costs as much as what metrics
//! compute on it.

use std::{
    ops::{Deref, DerefMut},
    sync::{Arc, Mutex, PoisonError},
};

/// Planes of one size that nobody uses.
#[derive(Clone, Default)]
pub struct Pool(Arc<Mutex<Vec<Vec<f64>>>>);

/// One value a pixel, row by row. Goes back to its pool in the end.
pub struct Plane {
    values: Vec<f64>,
    pool: Pool,
}

impl Pool {
    /// A plane of `n` values, whatever they are.
    pub fn plane(&self, n: usize) -> Plane {
        let mut values = self.spare(|spare| spare.pop()).unwrap_or_default();
        values.resize(n, 0.0);
        Plane {
            values,
            pool: self.clone(),
        }
    }

    fn spare<R>(&self, f: impl FnOnce(&mut Vec<Vec<f64>>) -> R) -> R {
        f(&mut self.0.lock().unwrap_or_else(PoisonError::into_inner))
    }
}

impl Drop for Plane {
    fn drop(&mut self) {
        let values = std::mem::take(&mut self.values);
        self.pool.spare(|spare| spare.push(values));
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
