//! What the page of a diagnosis has beside the style of all pages.

/// Causes, maps of the floor.
pub(super) const STYLE: &str = "\
.verdict{font-size:19px;line-height:1.4}\
.big{font-size:32px;font-weight:650;line-height:1.1;font-variant-numeric:tabular-nums}\
.cause{display:grid;gap:8px;margin-bottom:12px}\
.cause header{display:flex;flex-wrap:wrap;gap:2px 14px;align-items:center}.cause header>:first-child{flex:1 1 300px}\
.cause header .track{flex:0 1 300px;min-width:130px}\
.cause .title{font-size:17px;font-weight:650}\
dl{display:grid;grid-template-columns:max-content 1fr;gap:3px 16px;margin:0}dt{color:var(--soft)}dd{margin:0;min-width:0}\
@media(max-width:560px){dl{grid-template-columns:1fr;gap:0}dd{margin-bottom:6px}}\
.bar{fill:var(--accent)}.dot{stroke:var(--faint);stroke-width:.5}.way{fill:none;stroke:var(--faint);stroke-width:1;opacity:.6}\
.limb{stroke:var(--faint);stroke-width:5;stroke-linecap:round}.limb.marked{stroke:var(--bad);stroke-width:7}\
.trunk{fill:var(--track);stroke:var(--faint);stroke-width:5;stroke-linejoin:round}.trunk.marked{stroke:var(--bad)}\
.pin{fill:var(--card);stroke:var(--soft);stroke-width:1.5}.pin.marked{fill:var(--bad);stroke:var(--ink)}\
.region{fill:none;stroke:var(--ink);stroke-width:1.4;stroke-dasharray:5 4}";
