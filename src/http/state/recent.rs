//! A cache of one value with a maximum age.

use std::time::Duration;

use tokio::{sync::Mutex, time::Instant};

/// The last value and when it was obtained. Concurrent callers wait for one lookup.
#[derive(Debug)]
pub(super) struct Recent<T> {
    max_age: Duration,
    last: Mutex<Option<(Instant, T)>>,
}

impl<T: Clone> Recent<T> {
    /// An empty cache whose values expire after `max_age`.
    pub(super) fn new(max_age: Duration) -> Self {
        Self { max_age, last: Mutex::new(None) }
    }

    /// The cached value, or a new one from `look` if it has expired.
    pub(super) async fn get(&self, look: impl AsyncFnOnce() -> T) -> T {
        let mut last = self.last.lock().await;
        if let Some((at, value)) = &*last
            && at.elapsed() < self.max_age
        {
            return value.clone();
        }
        let value = look().await;
        *last = Some((Instant::now(), value.clone()));
        value
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test]
    async fn a_value_is_looked_up_again_only_when_it_has_expired() {
        let looks = std::cell::Cell::new(0);
        let look = async || looks.replace(looks.get() + 1);
        let recent = Recent::new(Duration::MAX);
        assert_eq!((recent.get(look).await, recent.get(look).await, looks.get()), (0, 0, 1));
        let recent = Recent::new(Duration::ZERO);
        assert_eq!((recent.get(look).await, recent.get(look).await, looks.get()), (1, 2, 3));
    }
}
