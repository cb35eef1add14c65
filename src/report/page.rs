//! HTML around the content: one document, one style sheet, no script and nothing from elsewhere.

/// Escapes text for HTML.
pub fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

/// A section with a heading.
pub fn section(title: &str, content: &str) -> String {
    format!("<section><h2>{}</h2>{content}</section>\n", escape(title))
}

/// Something that can be folded up, and is unless it is to be open.
pub fn fold(title: &str, content: &str, is_open: bool) -> String {
    let open = if is_open { " open" } else { "" };
    format!("<details{open}><summary>{}</summary>{content}</details>\n", escape(title))
}

/// A table; cells are HTML.
pub fn table(head: &[&str], rows: &[Vec<String>]) -> String {
    let row = |tag: &str, cells: &mut dyn Iterator<Item = &str>| {
        let cells: String = cells.map(|c| format!("<{tag}>{c}</{tag}>")).collect();
        format!("<tr>{cells}</tr>")
    };
    let body: String = rows.iter().map(|r| row("td", &mut r.iter().map(String::as_str))).collect();
    let head = row("th", &mut head.iter().copied());
    format!("<div class=\"wide\"><table><thead>{head}</thead><tbody>{body}</tbody></table></div>\n")
}

/// The whole document.
pub fn document(title: &str, body: &str) -> String {
    let title = escape(title);
    format!(
        "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n<title>{title}</title>\n<style>{STYLE}</style></head>\n<body><main><h1>{title}</h1>\n{body}</main></body></html>\n"
    )
}

const STYLE: &str = "
:root{color-scheme:light dark;--ink:#1c2126;--soft:#5c6670;--paper:#fbfbf9;--card:#fff;--line:#dcdfe2;--grid:#e6e8ea;--good:#1b7f4b;--bad:#b3401f;--accent:#1f6fb2}
@media (prefers-color-scheme:dark){:root{--ink:#e4e7ea;--soft:#9aa4ad;--paper:#15181b;--card:#1d2125;--line:#343a40;--grid:#2b3035;--good:#58c48d;--bad:#f08a64;--accent:#6db3ee}}
*{box-sizing:border-box}body{margin:0;background:var(--paper);color:var(--ink);font:16px/1.5 system-ui,sans-serif}
main{max-width:1180px;margin:0 auto;padding:1.5rem}h1{font-size:1.8rem;margin:.2em 0}h2{font-size:1.25rem;margin:2.2em 0 .6em;border-bottom:1px solid var(--line);padding-bottom:.3em}h3{font-size:1rem;margin:1.4em 0 .3em}
p{max-width:75ch}.soft,figcaption,th{color:var(--soft)}.note{border-left:4px solid var(--bad);padding:.5em 1em;background:var(--card)}
.tiles{display:grid;grid-template-columns:repeat(auto-fit,minmax(170px,1fr));gap:.8rem;margin:1.2rem 0}.tile{background:var(--card);border:1px solid var(--line);border-radius:8px;padding:.7rem .9rem}.tile b{display:block;font-size:1.5rem;font-variant-numeric:tabular-nums}.tile span{color:var(--soft);font-size:.85rem}
.wide{overflow-x:auto}table{border-collapse:collapse;font-size:.9rem;font-variant-numeric:tabular-nums;margin:.5rem 0}th,td{text-align:right;padding:.3rem .8rem;border-bottom:1px solid var(--line);white-space:nowrap}th{font-weight:600}th:first-child,td:first-child{text-align:left}.text td{text-align:left;white-space:normal;overflow-wrap:anywhere}
.good{color:var(--good)}.bad{color:var(--bad)}
figure{margin:0}figcaption{font-size:.82rem;margin:.25rem 0 .8rem}.shots{display:grid;grid-template-columns:repeat(auto-fill,minmax(min(100%,520px),1fr));gap:.4rem 1.2rem}
.strip{position:relative;line-height:0;background:var(--card)}.strip img{width:100%;height:auto;border-radius:4px}.strip i{position:absolute;border:1.5px solid #fff;outline:1px solid #0009;border-radius:2px;pointer-events:none}
.panes{display:grid;grid-template-columns:1fr 1fr 1fr;font-size:.75rem;color:var(--soft);text-align:center}
.plots{display:grid;grid-template-columns:repeat(auto-fit,minmax(min(100%,520px),1fr));gap:1rem}.plots figure{background:var(--card);border:1px solid var(--line);border-radius:8px;padding:.6rem}svg{width:100%;height:auto;display:block}
details{margin:.5rem 0;background:var(--card);border:1px solid var(--line);border-radius:8px;padding:.4rem .9rem}summary{cursor:pointer;font-weight:600}pre{overflow:auto;max-height:30rem;font-size:.8rem}
";
