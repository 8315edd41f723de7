//! The style sheet of the page.

/// The exact bytes between `<style>` and `</style>`: a content security policy can name their hash.
///
/// Colour never carries information alone: shapes, dashes and words repeat it.
pub const STYLE: &str = r#"
:root{color-scheme:light dark;--paper:#fbfaf7;--card:#fff;--ink:#1f262b;--soft:#5d676e;--line:#dedad1;--grid:#ebe8e1;--blue:#1f5d8c;--law:#8b8f93;--warm:#b9480f;--good:#25734a;--usable:#8a5a00;--poor:#ad241d}
@media (prefers-color-scheme:dark){:root{--paper:#14181b;--card:#1a1f23;--ink:#e7e5e0;--soft:#a3abb1;--line:#353c42;--grid:#262c31;--blue:#7db7e6;--law:#878d92;--warm:#ff9a62;--good:#74cf9d;--usable:#eab84e;--poor:#ff8a80}}
*{box-sizing:border-box}
body{margin:0;background:var(--paper);color:var(--ink);font:16px/1.5 system-ui,-apple-system,"Segoe UI",Roboto,"Helvetica Neue",Arial,sans-serif}
main{max-width:72rem;margin:0 auto;padding:1.5rem 1rem 4rem}
h1{font-size:1.35rem;font-weight:600;margin:0;overflow-wrap:anywhere}
h2{font-size:1.12rem;font-weight:600;margin:2.75rem 0 .5rem}
h3{font-size:.95rem;font-weight:600;margin:1.5rem 0 .25rem}
p{margin:.4rem 0;max-width:46rem;overflow-wrap:anywhere}
a{color:var(--blue)}
.over{color:var(--soft);font-size:.85rem;letter-spacing:.02em;margin:0}
.sub,.hint{color:var(--soft);font-size:.9rem}
.note{color:var(--soft);font-style:italic}
.verdict{display:flex;flex-wrap:wrap;gap:.5rem 1.25rem;align-items:baseline;margin:1.25rem 0 .5rem;padding:1rem 1.25rem;background:var(--card);border:1px solid var(--line);border-left:.5rem solid var(--tone);border-radius:.4rem}
.verdict p{font-size:1.3rem;line-height:1.4;margin:0;flex:1 1 20rem;max-width:none}
.grade{color:var(--tone);font-weight:700;font-size:1.6rem;white-space:nowrap}
.good{--tone:var(--good)}.usable{--tone:var(--usable)}.poor{--tone:var(--poor)}
.findings{padding-left:1.2rem;max-width:48rem}.findings li{margin:.4rem 0;overflow-wrap:anywhere}
code{font:.8em ui-monospace,SFMono-Regular,Menlo,Consolas,monospace;color:var(--soft);white-space:nowrap}
.facts{display:grid;grid-template-columns:minmax(8rem,13rem) 1fr;margin:.75rem 0;border-top:1px solid var(--line)}
.facts dt,.facts dd{margin:0;padding:.5rem .75rem .5rem 0;border-bottom:1px solid var(--line)}
.facts dt{color:var(--soft)}.facts dd{overflow-wrap:anywhere}
.facts small{display:block;color:var(--soft);font-size:.88rem}
.maps,.charts{display:grid;gap:1.25rem;margin:1rem 0}
.maps{grid-template-columns:repeat(auto-fill,minmax(min(100%,15.5rem),1fr))}
.charts{grid-template-columns:repeat(auto-fill,minmax(min(100%,20rem),1fr))}
figure{margin:0;min-width:0;break-inside:avoid}
.charts figure{background:var(--card);border:1px solid var(--line);border-radius:.4rem;padding:.6rem .6rem .3rem}
figcaption{font-size:.88rem;line-height:1.4;overflow-wrap:anywhere}
.charts figcaption{font-weight:600}
.charts figcaption small{display:block;font-weight:400;color:var(--soft);font-size:.82rem}
.maps figcaption{margin-top:.25rem}.maps figcaption span{display:block;color:var(--soft)}
svg{display:block;width:100%;height:auto}
.none{color:var(--soft);font-size:.9rem;padding:2rem .5rem}
.key{display:flex;flex-wrap:wrap;gap:.25rem 1.25rem;color:var(--soft);font-size:.88rem;margin:.5rem 0}
.key span{display:inline-flex;align-items:center;gap:.4rem}.key svg{width:1.6rem;height:1rem;flex:none}
text{font:11.5px system-ui,-apple-system,"Segoe UI",Roboto,"Helvetica Neue",Arial,sans-serif;fill:var(--soft)}
.e{text-anchor:end}.m{text-anchor:middle}
.f{fill:var(--card);stroke:var(--line)}.g{stroke:var(--grid);fill:none}.x{stroke:var(--soft);fill:none}
.i{fill:var(--grid)}.r{stroke:var(--line);stroke-dasharray:1 3;stroke-linecap:round;stroke-width:1.5}
.law{fill:none;stroke:var(--law);stroke-width:1.5}
.lim{fill:none;stroke:var(--warm);stroke-width:1.5;stroke-dasharray:6 4}
.w{fill:var(--warm)}
.p{fill:var(--blue);stroke:var(--blue);stroke-width:1.5}.p.b{fill:var(--ink);stroke:var(--ink)}
.p.h,.p.b.h{fill:var(--card)}
.d{fill:none;stroke:var(--soft);stroke-width:2.4;stroke-linecap:round}
.u{fill:none;stroke:var(--law);stroke-width:2.4;stroke-linecap:round}
.a{fill:none;stroke:var(--blue);stroke-width:1.1;stroke-linejoin:round;stroke-linecap:round}
.o{fill:none;stroke:var(--warm);stroke-width:1.8;stroke-linecap:round}
.oa{fill:none;stroke:var(--warm);stroke-width:1.1;stroke-dasharray:3 2}
.k{stroke:var(--ink);stroke-width:1.5;fill:none}
.wide{overflow-x:auto;margin:.75rem 0}
table{border-collapse:collapse;font-size:.82rem;font-variant-numeric:tabular-nums}td{white-space:nowrap}
th{font-weight:600;text-align:right;color:var(--soft);vertical-align:bottom}
th,td{padding:.3rem .5rem;border-bottom:1px solid var(--line);text-align:right}
th:first-child,td:first-child{padding-left:0}
.l th:nth-child(-n+3),.l td:nth-child(-n+3),.c th:first-child,.c td:first-child{text-align:left}
.l td:nth-child(2){max-width:12rem;overflow:hidden;text-overflow:ellipsis}
tr.chosen td{font-weight:700}tr.guess td{font-style:italic;color:var(--soft)}
@media (max-width:34rem){.facts{grid-template-columns:1fr}.facts dt{border:0;padding-bottom:0}.verdict p{font-size:1.1rem}}
@media print{:root{color-scheme:light;--paper:#fff;--card:#fff;--ink:#000;--soft:#444;--line:#bbb;--grid:#e4e4e4;--blue:#123f60;--law:#777;--warm:#8f3000;--good:#1b5535;--usable:#5c3c00;--poor:#7e150f}body{font-size:12px}main{max-width:none;padding:0}a{color:inherit}.wide{overflow:visible}table{font-size:.7rem}td{white-space:normal}th,td{padding:.15rem .3rem}}
"#;
