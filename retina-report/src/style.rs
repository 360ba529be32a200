//! How a page looks: on paper, in the dark, on a telephone.

/// Panels lie in as many columns as fit; drawings of several panels keep their size and scroll within their own box, as
/// tables do. A figure's inks are those of white paper: in the dark each is exchanged for one that is read there.
pub(crate) const STYLE: &str = ":root{color-scheme:light dark;--ink:#222;--paper:#fff;--shade:#f6f6f6;--line:#ddd;--faint:#555}\
    body{font:15px/1.5 sans-serif;max-width:1400px;margin:2em auto;padding:0 1em;color:var(--ink);background:var(--paper);overflow-wrap:break-word}\
    h1,h2{line-height:1.25}\
    pre{background:var(--shade);padding:1em;overflow-x:auto}img{max-width:100%;height:auto}\
    .wide{overflow-x:auto}.wide>svg{display:block;height:auto;max-width:none}\
    .figures{display:grid;grid-template-columns:repeat(auto-fill,minmax(min(100%,25rem),1fr));gap:.6rem}\
    .figures>svg{display:block;width:100%;height:auto}\
    table{border-collapse:collapse}\
    th,td{padding:.2em .8em;border-bottom:1px solid var(--line);text-align:right}\
    th:first-child,td:first-child{text-align:left;position:sticky;left:0;background:var(--paper)}\
    th.text,td.text{text-align:left;min-width:16em}\
    figcaption{color:var(--faint);max-width:60em}figure{margin:1em 0}\
    .card{border:1px solid var(--line);border-left:.5em solid #0072b2;background:var(--shade);padding:.6em 1em;margin:1em 0}\
    .card h2{margin:.1em 0 .4em}.card dl{display:grid;grid-template-columns:max-content 1fr;gap:.2em 1em;margin:0}\
    .card dt{color:var(--faint)}.card dd{margin:0}\
    @media(max-width:600px){body{margin:1em auto;padding:0 .7em}pre{font-size:12px}h1{font-size:1.5em}h2{font-size:1.2em}\
    .card dl{display:block}.card dd{margin:0 0 .4em}th,td{padding:.2em .5em}}\
    article+article{border-top:2px solid var(--line);margin-top:3em}\
    @media(prefers-color-scheme:dark){:root{--ink:#ddd;--paper:#181818;--shade:#242424;--line:#444;--faint:#aaa}\
    a{color:#7ab8ea}figure img{background:#fff}\
    svg>title+rect[fill=\"#ffffff\"]{fill:var(--paper)}\
    svg text{fill:#ddd}svg [stroke=\"#222222\"]{stroke:#aaa}svg [stroke=\"#000000\"]{stroke:#eee}\
    svg [fill=\"#222222\"]{fill:#ddd}svg path[fill=\"#000000\"]{fill:#eee}\
    svg [stroke=\"#e4e4e4\"]{stroke:#3a3a3a}\
    svg [stroke=\"#0072b2\"]{stroke:#4aa8e8}svg path[fill=\"#0072b2\"]{fill:#4aa8e8}\
    svg [stroke=\"#d55e00\"]{stroke:#f58a3c}svg path[fill=\"#d55e00\"]{fill:#f58a3c}\
    svg [stroke=\"#009e73\"]{stroke:#2cc79a}svg path[fill=\"#009e73\"]{fill:#2cc79a}}";

#[cfg(test)]
mod tests {
    use super::STYLE;

    /// Braces pair up, and nothing is fetched from elsewhere.
    #[test]
    fn the_style_is_whole_and_stands_alone() {
        let mut depth = 0i32;
        for c in STYLE.chars() {
            depth += i32::from(c == '{') - i32::from(c == '}');
            assert!((0..=2).contains(&depth));
        }
        assert_eq!(depth, 0);
        assert!(!STYLE.contains("url(") && !STYLE.contains("@import"));
    }

    /// Every ink that a figure uses beside its palette of lighter ones has a counterpart in the dark.
    #[test]
    fn dark_inks_have_counterparts() {
        let dark = STYLE.split("prefers-color-scheme:dark").nth(1).unwrap_or_default();
        let mut inks = vec![retina_plot::Colour::INK, retina_plot::Colour::BLACK, retina_plot::Colour::PALE];
        inks.extend(
            retina_plot::PALETTE
                .iter()
                .copied()
                .filter(|c| u32::from(c.0) + u32::from(c.1) + u32::from(c.2) < 310),
        );
        for ink in inks {
            assert!(dark.contains(&format!("[stroke=\"{ink}\"]")), "{ink}");
        }
    }
}
