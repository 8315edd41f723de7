//! What stays in the cache.

use tempfile::NamedTempFile;

use super::*;
use crate::{
    contract::artifact::{Colours, FileFormat},
    jobs::SliceLight,
};

/// Adds a file, made now.
fn keep(cache: &mut Cache, digest: &str, form: Form, length: u64) {
    let file = NamedTempFile::new().expect("a file");
    let converted = Converted { file, source: digest.to_owned(), length };
    cache.keep((digest.to_owned(), form), Arc::new(converted));
}

/// Uses a file. False when it is not in the cache.
fn uses(cache: &mut Cache, digest: &str, form: Form) -> bool {
    cache.used(&(digest.to_owned(), form)).is_some()
}

/// The digests that are in the cache, sorted. This is no use of them.
fn digests(cache: &Cache) -> Vec<&str> {
    let mut digests: Vec<&str> = cache.entries.keys().map(|(digest, _)| digest.as_str()).collect();
    digests.sort_unstable();
    digests
}

#[test]
fn the_file_that_was_used_longest_ago_is_evicted() {
    for form in [Form::File(FileFormat::Tiff), Form::Pyramid(Colours::Plain), Form::Slice(SliceLight::Front, 0)] {
        let mut cache = Cache::default();
        for digest in ["a", "b", "c"] {
            keep(&mut cache, digest, form, KEEP_BYTES / 3);
        }
        assert!(uses(&mut cache, "a", form));
        assert!(!uses(&mut cache, "a", Form::File(FileFormat::Jpeg)));
        keep(&mut cache, "d", form, KEEP_BYTES / 3);
        cache.evict();
        assert_eq!(digests(&cache), ["a", "c", "d"], "{form:?}");
    }
}

#[test]
fn the_number_of_files_is_limited_and_at_least_one_stays() {
    let mut cache = Cache::default();
    for index in 0..=KEEP_FILES {
        keep(&mut cache, "stack", Form::Slice(SliceLight::Front, index), 1);
    }
    assert!(uses(&mut cache, "stack", Form::Slice(SliceLight::Front, 0)));
    cache.evict();
    assert_eq!(cache.entries.len(), KEEP_FILES);
    assert!(uses(&mut cache, "stack", Form::Slice(SliceLight::Front, 0)), "it was used");
    assert!(!uses(&mut cache, "stack", Form::Slice(SliceLight::Front, 1)), "it was used longest ago");
    keep(&mut cache, "large", Form::Slice(SliceLight::Front, 0), 2 * KEEP_BYTES);
    cache.evict();
    assert_eq!(digests(&cache), ["large"]);
}
