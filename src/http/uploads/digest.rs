//! The SHA-256 of an upload. Its state is stored between requests, so that the bytes need not be read again at the end.

use sha2::{
    Digest, Sha256,
    digest::common::hazmat::{SerializableState, SerializedState},
};

use crate::{
    http::{ApiError, ApiResult},
    store::digest::hex,
};

/// A digest whose state can be stored and resumed.
#[derive(Clone, Default)]
pub struct RunningDigest(Sha256);

impl RunningDigest {
    /// Resumes from a stored state.
    ///
    /// # Errors
    /// When the bytes are not the state of a digest.
    pub fn resume(state: &[u8]) -> ApiResult<Self> {
        let state = SerializedState::<Sha256>::try_from(state)
            .map_err(|_| ApiError::internal("the row of an upload does not contain the state of a digest"))?;
        let hash = Sha256::deserialize(&state).map_err(|e| ApiError::internal(format!("digest of an upload: {e}")))?;
        Ok(Self(hash))
    }

    /// The state to store.
    pub fn state(&self) -> Vec<u8> {
        self.0.serialize().to_vec()
    }

    /// Adds bytes.
    pub fn update(&mut self, bytes: &[u8]) {
        self.0.update(bytes);
    }

    /// The digest, hex.
    pub fn finish(self) -> String {
        hex(&self.0.finalize())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_digest_resumed_at_any_byte_is_that_of_the_whole() {
        let bytes: Vec<u8> = (0..200_u8).collect();
        let whole = hex(&Sha256::digest(&bytes));
        for cut in 0..=bytes.len() {
            let mut first = RunningDigest::default();
            first.update(&bytes[..cut]);
            let mut second = RunningDigest::resume(&first.state()).expect("its own state");
            second.update(&bytes[cut..]);
            assert_eq!(second.finish(), whole, "cut at {cut}");
        }
        assert!(RunningDigest::resume(b"too short").is_err());
    }
}
