//! What stays in the cache.

use super::*;

/// Adds a file, made now.
fn keep(conversions: &Conversions, digest: &str, form: Form, length: u64) {
    let file = NamedTempFile::new().expect("a file");
    let mut entries = conversions.entries();
    entries.1 += 1;
    let now = entries.1;
    let converted = Arc::new(Converted { file, source: digest.to_owned(), length });
    entries.0.insert((digest.to_owned(), form), Entry::Kept(converted, now));
}

/// The digests that are in the cache, sorted. This is no use of them.
fn digests(conversions: &Conversions) -> Vec<String> {
    let mut digests: Vec<String> = conversions.entries().0.keys().map(|(digest, _)| digest.clone()).collect();
    digests.sort();
    digests
}

#[test]
fn the_file_that_was_used_longest_ago_is_evicted() {
    for form in [Form::File(FileFormat::Tiff), Form::Pyramid(Colours::Plain), Form::Slice(0)] {
        let conversions = Conversions::default();
        for digest in ["a", "b", "c"] {
            keep(&conversions, digest, form, KEEP_BYTES / 3);
        }
        assert!(conversions.kept("a", form).is_some());
        assert!(conversions.kept("a", Form::File(FileFormat::Jpeg)).is_none());
        keep(&conversions, "d", form, KEEP_BYTES / 3);
        evict(&mut conversions.entries().0);
        assert_eq!(digests(&conversions), ["a", "c", "d"], "{form:?}");
    }
}

#[test]
fn the_number_of_files_is_limited_and_at_least_one_stays() {
    let conversions = Conversions::default();
    for index in 0..=KEEP_FILES {
        keep(&conversions, "stack", Form::Slice(index), 1);
    }
    assert!(conversions.kept("stack", Form::Slice(0)).is_some());
    evict(&mut conversions.entries().0);
    assert_eq!(conversions.entries().0.len(), KEEP_FILES);
    assert!(conversions.kept("stack", Form::Slice(0)).is_some(), "it was used");
    assert!(conversions.kept("stack", Form::Slice(1)).is_none(), "it was used longest ago");
    keep(&conversions, "large", Form::Slice(0), 2 * KEEP_BYTES);
    evict(&mut conversions.entries().0);
    assert_eq!(digests(&conversions), ["large"]);
}
