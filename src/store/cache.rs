//! Rows that were read before and can no longer change. A statement costs a tenth of a millisecond before it reads anything,
//! because it goes to the connection's thread and back, and a dashboard or a CI asks for the same reports again and again.

use super::StoreError;
use std::{
    collections::HashMap,
    hash::Hash,
    sync::{Mutex, MutexGuard, PoisonError},
};

/// Values by the key that they were asked for with.
pub(super) struct Cache<K, V> {
    kept: Mutex<Kept<K, V>>,
    /// More rows than this, and it starts anew.
    max_rows: usize,
}

struct Kept<K, V> {
    rows: HashMap<K, V>,
    /// How often everything was forgotten. What a reader began to read before that is not kept.
    era: u64,
}

impl<K: Clone + Eq + Hash, V: Clone> Cache<K, V> {
    pub fn new(max_rows: usize) -> Self {
        let kept = Kept {
            rows: HashMap::new(),
            era: 0,
        };
        Self {
            kept: Mutex::new(kept),
            max_rows,
        }
    }

    /// The values of those `keys` that have one. `load` is asked for what is not here, and what it finds is kept where it
    /// `lasts`.
    pub async fn get(
        &self,
        keys: &[K],
        lasts: impl Fn(&V) -> bool,
        load: impl AsyncFnOnce(&[K]) -> Result<Vec<(K, V)>, StoreError>,
    ) -> Result<HashMap<K, V>, StoreError> {
        let (era, mut found) = {
            let kept = self.lock();
            let known = keys
                .iter()
                .filter_map(|key| Some((key.clone(), kept.rows.get(key)?.clone())));
            (kept.era, known.collect::<HashMap<K, V>>())
        };
        let missing: Vec<K> = keys.iter().filter(|key| !found.contains_key(key)).cloned().collect();
        if missing.is_empty() {
            return Ok(found);
        }
        let loaded = load(&missing).await?;
        let mut kept = self.lock();
        if kept.era == era && loaded.len() <= self.max_rows {
            if kept.rows.len() + loaded.len() > self.max_rows {
                kept.rows.clear();
            }
            kept.rows
                .extend(loaded.iter().filter(|(_, value)| lasts(value)).cloned());
        }
        found.extend(loaded);
        Ok(found)
    }

    /// Forgets everything; after the change that makes it wrong was committed, and before anybody is told of it.
    pub fn clear(&self) {
        let mut kept = self.lock();
        kept.era += 1;
        kept.rows.clear();
    }

    /// No code that can panic runs while it is locked.
    fn lock(&self) -> MutexGuard<'_, Kept<K, V>> {
        self.kept.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What was found, and what had to be loaded for it: ten times each key below 100; 20 does not last.
    async fn asked(cache: &Cache<i64, i64>, keys: &[i64]) -> (Vec<i64>, Vec<i64>) {
        let mut loaded = Vec::new();
        let load = async |missing: &[i64]| {
            loaded = missing.to_vec();
            Ok(missing
                .iter()
                .filter(|key| **key < 100)
                .map(|key| (*key, key * 10))
                .collect())
        };
        let found = cache.get(keys, |value| *value != 20, load).await.unwrap();
        (keys.iter().filter_map(|key| found.get(key).copied()).collect(), loaded)
    }

    #[tokio::test]
    async fn only_what_lasts_is_kept() {
        let cache = Cache::new(10);
        assert_eq!(
            asked(&cache, &[3, 1, 100, 2]).await,
            (vec![30, 10, 20], vec![3, 1, 100, 2])
        );
        assert_eq!(asked(&cache, &[1, 2, 3]).await, (vec![10, 20, 30], vec![2]));
        cache.clear();
        assert_eq!(asked(&cache, &[3]).await, (vec![30], vec![3]));
    }

    #[tokio::test]
    async fn what_was_read_before_a_change_is_not_kept_after_it() {
        let cache = Cache::new(10);
        let load = async |_: &[i64]| {
            cache.clear();
            Ok(vec![(1, 10)])
        };
        assert_eq!(cache.get(&[1], |_| true, load).await.unwrap()[&1], 10);
        assert_eq!(asked(&cache, &[1]).await.1, [1]);
    }

    #[tokio::test]
    async fn it_has_a_limit() {
        let cache = Cache::new(2);
        asked(&cache, &[3, 4]).await;
        asked(&cache, &[5]).await;
        assert_eq!(asked(&cache, &[5, 3]).await.1, [3]);
        asked(&cache, &[6, 7, 8]).await;
        assert!(asked(&cache, &[5, 3]).await.1.is_empty());
    }
}
