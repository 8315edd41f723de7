//! Seeking within a stream that can only be read forward.

use std::io::{self, Read, Seek, SeekFrom};

/// Bytes kept from the start.
const HEAD: usize = 256 << 10;

/// Bytes kept before the furthest position that was read.
const TAIL: usize = 1 << 20;

/// Bytes decompressed at a time.
const STEP: usize = 64 << 10;

/// A forward reader that keeps the first and the latest bytes, so that the header of a picture can be read from a
/// compressed member. Headers are at the start, those of TIFF files often near the end. Memory is bounded.
pub(super) struct SeekWindow<R> {
    inner: R,
    length: u64,
    /// Maximum number of bytes read from `inner`.
    most: u64,
    at: u64,
    head: Vec<u8>,
    tail: Vec<u8>,
    /// Bytes read from `inner`; `tail` ends there.
    reached: u64,
    fell_behind: bool,
    stopped: bool,
}

impl<R: Read> SeekWindow<R> {
    /// A window on `inner`, which declares `length` bytes, and of which about `most` bytes are read.
    pub(super) fn new(inner: R, length: u64, most: u64) -> Self {
        let (head, tail) = (Vec::new(), Vec::new());
        Self { inner, length, most, at: 0, head, tail, reached: 0, fell_behind: false, stopped: false }
    }

    /// True after a read beyond the maximum.
    pub(super) fn was_stopped(&self) -> bool {
        self.stopped
    }

    /// True after a read of bytes that are no longer kept: only reading the whole member gives them.
    pub(super) fn fell_behind(&self) -> bool {
        self.fell_behind
    }

    /// Reads ahead until `at` is reached; false at the end.
    fn reach(&mut self) -> io::Result<bool> {
        while self.at >= self.reached {
            if self.reached >= self.most {
                self.stopped = true;
                return Err(io::Error::other("beyond the bytes that may be read"));
            }
            if self.tail.len() >= 2 * TAIL {
                self.tail.drain(..self.tail.len() - TAIL);
            }
            let before = self.tail.len();
            self.tail.resize(before + STEP, 0);
            let read = self.inner.read(&mut self.tail[before..]);
            self.tail.truncate(before + *read.as_ref().unwrap_or(&0));
            if read? == 0 {
                return Ok(false);
            }
            let new = &self.tail[before..];
            let room = HEAD.saturating_sub(self.head.len()).min(new.len());
            self.head.extend_from_slice(&new[..room]);
            self.reached += new.len() as u64;
        }
        Ok(true)
    }
}

impl<R: Read> Read for SeekWindow<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        if !self.reach()? {
            return Ok(0);
        }
        let tail_start = self.reached - self.tail.len() as u64;
        let kept = if self.at < self.head.len() as u64 {
            &self.head[self.at as usize..]
        } else if self.at >= tail_start {
            &self.tail[(self.at - tail_start) as usize..]
        } else {
            self.fell_behind = true;
            return Err(io::Error::other("no longer in the window"));
        };
        let count = kept.len().min(buffer.len());
        buffer[..count].copy_from_slice(&kept[..count]);
        self.at += count as u64;
        Ok(count)
    }
}

impl<R> Seek for SeekWindow<R> {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        self.at = position(to, self.at, self.length)?;
        Ok(self.at)
    }
}

/// Where a seek leads in a file of `length` bytes, from the position `at`.
pub(super) fn position(to: SeekFrom, at: u64, length: u64) -> io::Result<u64> {
    let target = match to {
        SeekFrom::Start(at) => Some(at),
        SeekFrom::End(by) => length.checked_add_signed(by),
        SeekFrom::Current(by) => at.checked_add_signed(by),
    };
    target.ok_or_else(|| io::Error::new(io::ErrorKind::InvalidInput, "seek before the start"))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn byte(at: usize) -> u8 {
        (at * 31 % 251) as u8
    }

    #[test]
    fn the_start_and_the_latest_bytes_can_be_read_again_and_the_middle_cannot() {
        let length = 5 << 20;
        let source: Vec<u8> = (0..length).map(byte).collect();
        let mut window = SeekWindow::new(source.as_slice(), length as u64, u64::MAX);
        let mut read_at = |at: usize| {
            let mut out = [0; 100];
            window.seek(SeekFrom::Start(at as u64)).unwrap();
            window.read_exact(&mut out).map(|()| out)
        };
        for at in [0, length - 100, length - 500_000, 1_000, HEAD - 100] {
            assert_eq!(read_at(at).unwrap(), std::array::from_fn(|i| byte(at + i)), "at {at}");
        }
        assert!(read_at(1 << 20).is_err());
        assert!(read_at(length).is_err(), "there is nothing after the end");
        assert!(window.fell_behind());
        assert!(window.tail.len() <= 2 * TAIL + STEP);
    }

    #[test]
    fn no_more_is_read_than_allowed() {
        let source: Vec<u8> = (0..5 << 20).map(byte).collect();
        let mut window = SeekWindow::new(source.as_slice(), source.len() as u64, 1 << 20);
        let mut out = [0; 100];
        window.seek(SeekFrom::Start((1 << 20) - 200)).unwrap();
        window.read_exact(&mut out).unwrap();
        assert!(!window.was_stopped());
        window.seek(SeekFrom::End(-200)).unwrap();
        assert!(window.read_exact(&mut out).is_err() && window.was_stopped());
        assert!(window.reached <= (1 << 20) + STEP as u64);
    }
}
