//! How the page looks, on a light screen and on a dark one.

/// The page's only style sheet. `h0` to `h8` are the colours of amounts, from none to much; `hn` is where nothing is known.
pub(super) const STYLE: &str = "\
:root{color-scheme:light dark;--ink:#1c2430;--soft:#5d6875;--faint:#8b95a1;--paper:#f6f6f3;--card:#fff;--line:#dfe3e8;\
--track:#eceff2;--before:#d9601a;--after:#1f6fb5;--floor:#9aa3ad;--measured:#1c2430;--accent:#5b6bb5;\
--good:#2c8a57;--fair:#b7791f;--bad:#b83a4b;\
--h0:#fdf6e3;--h1:#feeac0;--h2:#fdd592;--h3:#fdb768;--h4:#fa9250;--h5:#ee6a3d;--h6:#d5412f;--h7:#ab1d2e;--h8:#76092d;\
--hn:#e4e7ea}\
@media(prefers-color-scheme:dark){:root{--ink:#e6e9ee;--soft:#a3adb9;--faint:#7c8793;--paper:#14181d;--card:#1b2027;\
--line:#343d48;--track:#2a313a;--before:#ff9d5c;--after:#6db3f2;--floor:#6d7783;--measured:#e6e9ee;--accent:#98a5ec;\
--good:#58c48b;--fair:#e3ad55;--bad:#f07f8e;\
--h0:#242a33;--h1:#3a2e43;--h2:#573152;--h3:#7b355a;--h4:#a23e57;--h5:#c8504d;--h6:#e66e41;--h7:#f69a40;--h8:#fdd26e;\
--hn:#101317}}\
*{box-sizing:border-box}\
body{margin:0 auto;max-width:1080px;padding:26px 20px 60px;background:var(--paper);color:var(--ink);\
font:15px/1.5 system-ui,-apple-system,'Segoe UI',sans-serif}\
h1{font-size:15px;font-weight:400;color:var(--soft);margin:0 0 10px;overflow-wrap:anywhere}h1 b{color:var(--ink)}\
h2{font-size:18px;margin:36px 0 10px}h3{font-size:13px;font-weight:600;color:var(--soft);margin:0 0 8px}\
p{margin:4px 0}.soft{color:var(--soft)}.small{font-size:13px}\
code{font:12.5px ui-monospace,SFMono-Regular,Menlo,monospace;color:var(--soft);overflow-wrap:anywhere}\
ul,ol{margin:0;padding-left:20px}li{margin:3px 0}\
.card{background:var(--card);border:1px solid var(--line);border-radius:8px;padding:14px 18px;min-width:0}\
.verdict{border-left:5px solid var(--tone);padding:16px 20px;font-size:19px;line-height:1.4}\
.badge{display:inline-block;margin-bottom:6px;padding:1px 10px;border-radius:20px;background:var(--tone);color:var(--card);\
font-size:13px;font-weight:600}\
.no_gap,.explained{--tone:var(--good)}.partly_explained{--tone:var(--fair)}.unexplained{--tone:var(--bad)}\
.grid{display:grid;gap:14px;grid-template-columns:repeat(auto-fit,minmax(min(100%,var(--min,300px)),1fr));align-items:start}\
.wide{--min:440px}.even{align-items:stretch}.stack{display:grid;gap:14px}\
.bars{display:grid;grid-template-columns:auto 1fr auto;gap:6px 12px;align-items:center}\
.bars.four{grid-template-columns:auto 1fr auto auto}\
.bars .name{overflow-wrap:anywhere;max-width:15em}\
.bars .value{text-align:right;font-variant-numeric:tabular-nums;white-space:nowrap}\
.track{position:relative;height:11px;border-radius:3px;background:var(--track);min-width:60px}\
.track i{position:absolute;left:0;top:0;bottom:0;border-radius:3px;background:var(--fill,var(--accent))}\
.track u{position:absolute;top:-3px;bottom:-3px;border:solid var(--ink);border-width:0 2px}\
.track u:after{content:'';position:absolute;left:0;right:0;top:50%;border-top:2px solid var(--ink);margin-top:-1px}\
.big{font-size:32px;font-weight:650;line-height:1.1;font-variant-numeric:tabular-nums}\
.cause{display:grid;gap:8px;margin-bottom:12px}\
.cause header{display:flex;flex-wrap:wrap;gap:2px 14px;align-items:center}.cause header>:first-child{flex:1 1 300px}\
.cause header .track{flex:0 1 300px;min-width:130px}\
.cause .title{font-size:17px;font-weight:650}\
dl{display:grid;grid-template-columns:max-content 1fr;gap:3px 16px;margin:0}dt{color:var(--soft)}dd{margin:0;min-width:0}\
.chip{display:inline-block;padding:0 8px;margin:1px 4px 1px 0;border:1px solid var(--line);border-radius:12px;font-size:13px;\
overflow-wrap:anywhere}\
.scroll{overflow-x:auto}\
svg{display:block;width:100%;height:auto;overflow:visible}.half{max-width:620px}svg text{font:11.5px system-ui,-apple-system,'Segoe UI',sans-serif;fill:var(--soft)}\
.legend{max-width:420px;margin-top:8px}svg .label{fill:var(--ink)}svg .halo{paint-order:stroke;stroke:var(--card);stroke-width:3px}\
.axis{stroke:var(--line);fill:none}.zero{stroke:var(--faint);fill:none}\
.line{fill:none;stroke-width:1.6;stroke-linejoin:round}\
.l-measured{stroke:var(--measured)}.l-before{stroke:var(--before)}.l-after{stroke:var(--after)}\
.l-measured{stroke-width:2.4;opacity:.55}.line.points{stroke-width:5;stroke-linecap:round}\
.key{display:inline-block;width:20px;height:3px;vertical-align:middle;margin:0 6px 0 16px;border-radius:2px}\
.key:first-child{margin-left:0}\
.bar{fill:var(--accent)}.dot{stroke:var(--faint);stroke-width:.5}.way{fill:none;stroke:var(--faint);stroke-width:1;opacity:.6}\
.region{fill:none;stroke:var(--ink);stroke-width:1.4;stroke-dasharray:5 4}\
.h0{fill:var(--h0)}.h1{fill:var(--h1)}.h2{fill:var(--h2)}.h3{fill:var(--h3)}.h4{fill:var(--h4)}.h5{fill:var(--h5)}\
.h6{fill:var(--h6)}.h7{fill:var(--h7)}.h8{fill:var(--h8)}.hn{fill:var(--hn)}\
table{border-collapse:collapse;width:100%;font-variant-numeric:tabular-nums;font-size:13.5px}\
th,td{padding:3px 10px;text-align:right;border-top:1px solid var(--line)}th{font-weight:600;color:var(--soft);border-top:0}\
th:first-child,td:first-child{text-align:left;padding-left:0}td:last-child,th:last-child{padding-right:0}\
td.left,th.left{text-align:left}td code,td.number{white-space:nowrap}summary{cursor:pointer}\
@media print{body{max-width:none}.card{break-inside:avoid}}";
