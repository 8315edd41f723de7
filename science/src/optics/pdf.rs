//! A target page as PDF.

use pdf_writer::{Content, Name, Pdf, Rect, Ref, Str, TextStr};

use super::sheet::TargetPage;

/// Points of 1/72 inch per mm.
const POINTS_PER_MM: f64 = 72.0 / 25.4;
/// Distance of the control points of a quarter circle from its ends, over the radius: the error of the radius is at
/// most 2.7e-4 of it.
const ARC: f64 = 0.552_284_749_831;
/// Height of the text, points.
const TEXT: f32 = 8.0;
/// Distance of lines of text, mm.
const LINE_MM: f64 = 4.0;

/// The page at true scale. Coordinates count from the lower edge.
pub(super) fn write(page: &TargetPage) -> Vec<u8> {
    let [catalog, pages, sheet, font, contents, info] = [1, 2, 3, 4, 5, 6].map(Ref::new);
    let size = Rect::new(0.0, 0.0, points(page.width), points(page.height));
    let mut pdf = Pdf::new();
    pdf.catalog(catalog).pages(pages);
    pdf.pages(pages).kids([sheet]).count(1);
    let mut one = pdf.page(sheet);
    one.parent(pages).media_box(size).contents(contents);
    one.resources().fonts().pair(Name(b"F1"), font);
    drop(one);
    pdf.type1_font(font).base_font(Name(b"Helvetica"));
    pdf.document_info(info).title(TextStr(&page.title)).producer(TextStr("pinstack"));
    pdf.stream(contents, &content(page));
    pdf.finish()
}

fn content(page: &TargetPage) -> Vec<u8> {
    let (ground, ink) = if page.inverted { (0.0, 1.0) } else { (1.0, 0.0) };
    let mut out = Content::new();
    out.set_fill_gray(ground).rect(0.0, 0.0, points(page.width), points(page.height)).fill_nonzero();
    out.set_fill_gray(ink);
    let y_of = |y: f64| page.height - y;
    for dot in &page.dots {
        circle(&mut out, dot.x, y_of(dot.y), dot.diameter / 2.0);
    }
    out.fill_nonzero();
    let [x, y] = page.caption_at;
    for (at, line) in page.caption.iter().enumerate() {
        out.begin_text().set_font(Name(b"F1"), TEXT);
        out.next_line(points(x), points(y_of(y + LINE_MM * at as f64))).show(Str(line.as_bytes())).end_text();
    }
    if let Some([x, length, y]) = page.check_line {
        out.set_stroke_gray(ink).set_line_width(points(0.2));
        out.move_to(points(x), points(y_of(y))).line_to(points(x + length), points(y_of(y))).stroke();
    }
    out.finish().to_vec()
}

/// Adds a circle about (`x`, `y`) to the path: four Bezier curves.
fn circle(out: &mut Content, x: f64, y: f64, radius: f64) {
    let at = |across: f64, up: f64| (points(x + across * radius), points(y + up * radius));
    let (start_x, start_y) = at(1.0, 0.0);
    out.move_to(start_x, start_y);
    for [from, to] in
        [[(1.0, 0.0), (0.0, 1.0)], [(0.0, 1.0), (-1.0, 0.0)], [(-1.0, 0.0), (0.0, -1.0)], [(0.0, -1.0), (1.0, 0.0)]]
    {
        // the tangent at each end points to where the other end lies
        let (x1, y1) = at(from.0 + ARC * to.0, from.1 + ARC * to.1);
        let (x2, y2) = at(to.0 + ARC * from.0, to.1 + ARC * from.1);
        let (x3, y3) = at(to.0, to.1);
        out.cubic_to(x1, y1, x2, y2, x3, y3);
    }
    out.close_path();
}

fn points(mm: f64) -> f32 {
    (mm * POINTS_PER_MM) as f32
}
