//! How pieces become parts, and how answers are read.

use super::*;

fn piece(key: &str, mib: Range<u64>) -> Piece {
    (key.to_owned(), mib.start << 20..mib.end << 20)
}

#[test]
fn short_pieces_are_joined_until_they_may_be_a_part() {
    let parts = parts_of([
        piece("a", 0..8),
        piece("b", 0..2),
        piece("c", 0..2),
        piece("d", 0..6),
        piece("e", 0..5),
        piece("f", 0..1),
        piece("g", 0..1),
    ]);
    assert_eq!(
        parts,
        [
            Part::Copy(piece("a", 0..8)),
            Part::Joined(vec![piece("b", 0..2), piece("c", 0..2), piece("d", 0..6)]),
            Part::Copy(piece("e", 0..5)),
            Part::Joined(vec![piece("f", 0..1), piece("g", 0..1)]),
        ]
    );
    assert_eq!(parts_of([piece("a", 3..4)]), [Part::Copy(piece("a", 3..4))]);
}

#[test]
fn a_large_piece_is_cut_into_equal_ranges() {
    let parts = parts_of([piece("a", 10..140)]);
    let range_of = |part: &Part| match part {
        Part::Copy((_, range)) => range.clone(),
        Part::Joined(pieces) => panic!("{pieces:?}"),
    };
    let ranges: Vec<_> = parts.iter().map(range_of).collect();
    assert_eq!(ranges.len(), 3);
    assert_eq!((ranges[0].start, ranges[2].end), (10 << 20, 140 << 20));
    assert!(ranges.windows(2).all(|two| two[0].end == two[1].start), "{ranges:?}");
    assert!(ranges.iter().all(|range| (LEAST..=MOST).contains(&(range.end - range.start))), "{ranges:?}");
}

#[test]
fn an_answer_is_read_even_if_the_copy_failed_after_its_status() {
    let of = |status, body: &str| Answer::of(status, &Bytes::copy_from_slice(body.as_bytes()));
    let copied = r#"<?xml version="1.0" encoding="UTF-8"?>
        <CopyPartResult xmlns="http://s3.amazonaws.com/doc/2006-03-01/"><LastModified>2026-11-25T00:00:00Z</LastModified>
        <ETag>&quot;abc&quot;</ETag></CopyPartResult>"#;
    match of(http::StatusCode::OK, copied) {
        Answer::Copied(id) => assert_eq!(id.content_id, "\"abc\""),
        other => panic!("{other:?}"),
    }
    let failed = |code| format!("<Error><Code>{code}</Code><Message>no</Message></Error>");
    let of_error = |status, code| of(status, &failed(code));
    assert!(matches!(of_error(http::StatusCode::OK, "InternalError"), Answer::Again(_)));
    assert!(matches!(of_error(http::StatusCode::NOT_FOUND, "NoSuchKey"), Answer::No(Obstacle::Gone)));
    assert!(matches!(of_error(http::StatusCode::NOT_IMPLEMENTED, "NotImplemented"), Answer::No(Obstacle::Unable)));
    assert!(matches!(of(http::StatusCode::NOT_IMPLEMENTED, ""), Answer::No(Obstacle::Unable)));
    assert!(matches!(of(http::StatusCode::BAD_GATEWAY, "<html>"), Answer::Again(_)));
}
