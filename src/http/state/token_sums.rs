//! A sum for each token: requests in progress, bytes claimed of its quota, bytes that its uploads reserve ahead.
//! Callers without a token share one sum.

use std::{
    collections::HashMap,
    sync::{Arc, Mutex, PoisonError},
};

use uuid::Uuid;

/// The sums by token. A sum of 0 takes no memory. Clones share the sums.
#[derive(Debug, Clone, Default)]
pub struct TokenSums(Arc<Mutex<HashMap<Option<Uuid>, u64>>>);

impl TokenSums {
    /// Changes the sum of a token, and returns what `change` returns. Nothing else changes the sums meanwhile.
    pub fn change<T>(&self, token: Option<Uuid>, change: impl FnOnce(&mut u64) -> T) -> T {
        let mut sums = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let sum = sums.entry(token).or_default();
        let result = change(sum);
        if *sum == 0 {
            sums.remove(&token);
        }
        result
    }
}
