//! What each reader refuses.

use super::*;

fn refused(text: &str, format: Option<PoseFormat>) -> String {
    read(text.as_bytes(), format).expect_err("a refusal").detail
}

#[test]
fn an_element_with_many_attributes_is_refused_before_it_is_parsed() {
    let attributes: String = (0..100_000).map(|at| format!(" a{at}=\"\"")).collect();
    let text = format!("<document>\n<chunk{attributes}/></document>");
    let detail = refused(&text, None);
    assert!(detail.starts_with("line 2: an element has more than 64 attributes"), "{detail}");
    // a quote, a `>` and a comment do not hide them
    for before in ["<a b='\"'/>", "<a b=\">\"", "<!-- ' <a b=\" -->", "<![CDATA[<a b=\"]]>", "<?a <b c=\"?>"] {
        let closed = if before.ends_with("\">\"") { "" } else { "<a" };
        let text = format!("<document>{before}{closed}{attributes}/></document>");
        assert!(refused(&text, None).contains("more than 64 attributes"), "{before}");
    }
}

#[test]
fn many_namespaces_are_refused_before_they_are_resolved() {
    let spaces: String = (0..65).map(|at| format!("<a xmlns:n{at}=\"n\">\n")).collect();
    let detail = refused(&format!("<document>{spaces}"), None);
    assert!(detail.starts_with("line 65: the XML has more than 64 namespaces"), "{detail}");
}

#[test]
fn ordinary_attributes_do_not_add_up() {
    let camera = |at: usize| {
        format!(
            "<camera id='{at}' sensor_id=\"0\" label=\"it's {at} > 0\">\n<!-- \"a\" --><transform>1 0 0 {at} 0 1 0 2 0 \
             0 1 3 0 0 0 1</transform></camera>\n"
        )
    };
    let cameras: String = (0..500).map(camera).collect();
    let text = format!("<document><chunk><cameras>{cameras}</cameras></chunk></document>");
    assert_eq!(read(text.as_bytes(), None).expect("poses").poses.len(), 500);
}

#[test]
fn a_long_row_of_csv_is_refused_with_its_line() {
    let commas = ",".repeat(1 << 20);
    // a quoted field may go on over many lines
    let quoted = format!(",\"{}\"", "\n,".repeat(1 << 19));
    for more in [commas, quoted] {
        let text = format!("name,x,y,z\na,0,0,1\nb,1,0,0{more}\nc,0,1,0\n");
        let detail = refused(&text, None);
        assert!(detail.starts_with("line 3: the row is longer than 64 KiB"), "{detail}");
        let detail = refused(&format!("name,x,y,z{more}\na,0,0,1\n"), None);
        assert!(detail.starts_with("line 1: the row is longer than 64 KiB"), "{detail}");
    }
    let notes = ",".repeat(40_000);
    let text = format!("name,x,y,z\n{}", format!("a,0,0,1{notes}\n").repeat(10));
    assert_eq!(read(text.as_bytes(), None).expect("short rows").poses.len(), 10);
}

#[test]
fn points_of_colmap_are_not_taken_for_images() {
    for line in [
        // X Y Z R G B as they usually are, and a point at distance 1 that is black
        "7 0.3 -1.2 4.5 120 64 30 0.61 3 17 4 92 5 88",
        "7 0.6 0.8 0 0 0 0 0.61 3 17 4 92 5 88",
        "7 0.6 0.8 0 0 0 0 0.61 3 17",
        "7.5 1 0 0 0 0 0 0 1 a.png",
        "7 1 0 0 0 0 0 0 1.5 a.png",
        "7 1 0 0.2 0 0 0 0 1 a.png",
        "7 NaN 0 0 0 0 0 0 1 a.png",
    ] {
        let detail = refused(&format!("# 3D point list\n{line}\n\n"), None);
        assert!(
            detail.starts_with("line 2: ") && detail.ends_with("send images and not cameras or points3D"),
            "{detail}"
        );
    }
    let found = read(b"7 0.707 0.707 0 0 0 0 0 1 bee 12 1.png\n\n", None).expect("six digits are not needed");
    assert_eq!(found.poses[0].name, "bee 12 1.png");
}

#[test]
fn images_of_colmap_without_their_lines_of_points_are_refused() {
    let image = |at: usize| format!("{at} 1 0 0 0 0 0 0 1 {at}.png\n");
    let detail = refused(&format!("# images\n{}{}", image(1), image(2)), None);
    assert!(detail.starts_with("line 3: a line of points is missing before this image"), "{detail}");
    assert!(detail.contains("a line with its points, which may be empty"), "{detail}");
    let spaced = refused("1 1 0 0 0 0 0 0 1 a b.png\n2 1 0 0 0 0 0 0 1 a c.png\n", None);
    assert!(spaced.starts_with("line 2: a line of points is missing"), "{spaced}");
    for points in ["", "1.5 2.5 -1", "1.5 2.5 -1 7 8 12 1.5 2.5 -1 7 8 12"] {
        let text = format!("{}{points}\n{}{points}\n", image(1), image(2));
        assert_eq!(read(text.as_bytes(), None).expect("images").poses.len(), 2, "{points}");
    }
}

#[test]
fn text_of_16_bits_is_named() {
    for (mark, bytes) in [([0xFF, 0xFE], u16::to_le_bytes as fn(u16) -> [u8; 2]), ([0xFE, 0xFF], u16::to_be_bytes)] {
        let wide: Vec<u8> = mark.into_iter().chain("name,x,y,z\n".encode_utf16().flat_map(bytes)).collect();
        for format in [None, Some(PoseFormat::Csv)] {
            let detail = read(&wide, format).expect_err("UTF-16").detail;
            assert_eq!(detail, "the file is UTF-16 text; save it as UTF-8");
        }
    }
}
