//! The ICC profile of a JPEG, which is stored in numbered parts.

/// The parts of a profile, each from one segment.
#[derive(Default)]
pub(super) struct IccParts(Vec<Part>);

struct Part {
    /// Position of the part, from 1 on.
    number: u8,
    /// Number of parts of the profile.
    count: u8,
    bytes: Vec<u8>,
}

impl IccParts {
    /// Adds the part in an APP2 segment. Segments without a profile are ignored.
    pub(super) fn add(&mut self, segment: &[u8]) {
        if let Some([number, count, bytes @ ..]) = segment.strip_prefix(b"ICC_PROFILE\0") {
            self.0.push(Part { number: *number, count: *count, bytes: bytes.to_vec() });
        }
    }

    /// True without any part.
    pub(super) fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// The profile, joined from its parts; `None` when one is missing.
    pub(super) fn joined(&self) -> Option<Vec<u8>> {
        let mut parts: Vec<&Part> = self.0.iter().collect();
        parts.sort_by_key(|part| part.number);
        let is_in_place =
            |(at, part): (usize, &&Part)| usize::from(part.number) == at + 1 && usize::from(part.count) == parts.len();
        let whole = !parts.is_empty() && parts.iter().enumerate().all(is_in_place);
        whole.then(|| parts.iter().flat_map(|part| part.bytes.iter().copied()).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn joined(parts: &[(u8, u8, &[u8])]) -> Option<Vec<u8>> {
        let mut found = IccParts::default();
        for (number, count, bytes) in parts {
            found.add(&[b"ICC_PROFILE\0", &[*number, *count][..], bytes].concat());
        }
        found.joined()
    }

    #[test]
    fn parts_are_joined_by_their_numbers() {
        assert_eq!(joined(&[(1, 1, b"abc")]).as_deref(), Some(&b"abc"[..]));
        assert_eq!(joined(&[(2, 3, b"b"), (1, 3, b"a"), (3, 3, b"c")]).as_deref(), Some(&b"abc"[..]));
    }

    #[test]
    fn a_profile_that_lacks_a_part_is_no_profile() {
        for parts in [
            &[][..],
            &[(1, 3, b"a"), (2, 3, b"b")],
            &[(2, 3, b"b"), (3, 3, b"c")],
            &[(1, 3, b"a"), (3, 3, b"c")],
            &[(1, 2, b"a"), (1, 2, b"a")],
            &[(1, 1, b"a"), (2, 1, b"b")],
            &[(0, 0, b"a")],
        ] {
            let parts: Vec<(u8, u8, &[u8])> = parts.iter().map(|&(n, count, b)| (n, count, &b[..])).collect();
            assert_eq!(joined(&parts), None, "{parts:?}");
        }
        let mut other = IccParts::default();
        other.add(b"FPXR\0\x01\x01");
        assert_eq!(other.joined(), None);
    }
}
