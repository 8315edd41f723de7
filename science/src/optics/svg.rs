//! A target page as SVG.

use std::fmt::Write;

use super::sheet::TargetPage;

/// Height of the text, mm.
const TEXT_MM: f64 = 2.8;
/// Distance of lines of text, mm.
const LINE_MM: f64 = 4.0;

/// The page, in millimetres: one unit of the view box is 1 mm.
pub(super) fn write(page: &TargetPage) -> String {
    let (width, height) = (number(page.width), number(page.height));
    let (ground, ink) = if page.inverted { ("black", "white") } else { ("white", "black") };
    let mut out = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}mm\" height=\"{height}mm\" viewBox=\"0 0 {width} {height}\">\n\
         <title>{}</title>\n<rect width=\"{width}\" height=\"{height}\" fill=\"{ground}\"/>\n<g fill=\"{ink}\">\n",
        page.title
    );
    for dot in &page.dots {
        let (x, y, radius) = (number(dot.x), number(dot.y), number(dot.diameter / 2.0));
        // writing to a String cannot fail
        let _ = writeln!(out, "<circle cx=\"{x}\" cy=\"{y}\" r=\"{radius}\"/>");
    }
    out.push_str("</g>\n");
    let [x, y] = page.caption_at;
    for (at, line) in page.caption.iter().enumerate() {
        let y = number(y + LINE_MM * at as f64);
        let _ = writeln!(
            out,
            "<text x=\"{}\" y=\"{y}\" font-family=\"Helvetica, Arial, sans-serif\" font-size=\"{TEXT_MM}\" fill=\"{ink}\">{line}</text>",
            number(x)
        );
    }
    if let Some([x, length, y]) = page.check_line {
        let (x, end, y) = (number(x), number(x + length), number(y));
        let _ = writeln!(out, "<path d=\"M{x} {y}H{end}\" stroke=\"{ink}\" stroke-width=\"0.2\"/>");
    }
    out.push_str("</svg>\n");
    out
}

/// A number with at most six decimals: a nanometre.
pub(super) fn number(value: f64) -> String {
    let text = format!("{value:.6}");
    text.trim_end_matches('0').trim_end_matches('.').to_owned()
}
