//! The thumbnails of the web pages: JPEGs of a few kB, made of previews. The newest are kept in memory.

use std::{
    collections::{HashMap, VecDeque},
    sync::{Mutex, PoisonError},
};

use bytes::Bytes;
use tokio::sync::Semaphore;

use crate::http::{ApiError, ApiResult, background};
use pinstack_science::imaging::{codec, thumbnail};

/// Longest side, px: twice what the list shows, for dense screens.
const MAX_SIDE: usize = 200;
/// Quality of the JPEG.
const QUALITY: u8 = 80;
/// Most thumbnails in memory, of about 6 kB each.
const KEPT: usize = 512;
/// Thumbnails that are made at a time.
const AT_A_TIME: usize = 2;
/// A preview has fewer pixels than this.
const MAX_PIXELS: u64 = 4_000_000;

/// The thumbnails in memory.
#[derive(Debug)]
pub struct Thumbnails {
    kept: Mutex<(HashMap<String, Bytes>, VecDeque<String>)>,
    turn: Semaphore,
}

impl Default for Thumbnails {
    fn default() -> Self {
        Self { kept: Mutex::default(), turn: Semaphore::new(AT_A_TIME) }
    }
}

impl Thumbnails {
    fn kept(&self, digest: &str) -> Option<Bytes> {
        self.kept.lock().unwrap_or_else(PoisonError::into_inner).0.get(digest).cloned()
    }

    fn keep(&self, digest: &str, jpeg: &Bytes) {
        let mut kept = self.kept.lock().unwrap_or_else(PoisonError::into_inner);
        let (by_digest, order) = &mut *kept;
        if by_digest.insert(digest.to_owned(), jpeg.clone()).is_none() {
            order.push_back(digest.to_owned());
        }
        while order.len() > KEPT {
            order.pop_front().map(|oldest| by_digest.remove(&oldest));
        }
    }

    /// The thumbnail of the preview with this digest. `preview` reads the preview, where the thumbnail is not in
    /// memory.
    ///
    /// # Errors
    /// Those of `preview`; `internal` when it cannot be decoded.
    pub async fn get(&self, digest: &str, preview: impl Future<Output = ApiResult<Bytes>>) -> ApiResult<Bytes> {
        if let Some(jpeg) = self.kept(digest) {
            return Ok(jpeg);
        }
        let _turn = self.turn.acquire().await.map_err(ApiError::internal)?;
        if let Some(jpeg) = self.kept(digest) {
            return Ok(jpeg);
        }
        let bytes = preview.await?;
        let made = background::blocking(move || made(&bytes)).await??;
        self.keep(digest, &made);
        Ok(made)
    }
}

fn made(preview: &[u8]) -> ApiResult<Bytes> {
    let limits = codec::Limits { max_pixels: MAX_PIXELS, ..codec::Limits::default() };
    let raster = codec::decode_rgba(preview, &limits).map_err(|error| ApiError::internal(format!("{error:?}")))?;
    let small = match raster.channels {
        4 => thumbnail::flattened(&raster, MAX_SIDE),
        _ => thumbnail::sampled(&raster, MAX_SIDE),
    };
    Ok(codec::encode_jpeg(&small, QUALITY).into())
}
