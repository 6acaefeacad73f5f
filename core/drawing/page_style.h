#pragma once

namespace saltus::drawing {

/// The style sheet of pages for people: neutral in light and dark, and white on paper.
inline constexpr char page_style[] = R"css(
:root { color-scheme: light dark; --back: #fafaf8; --card: #fff; --ink: #1d2126; --soft: #62686f; --line: #dcdedf;
        --c0: #1f5fa8; --c1: #c2541b; --c2: #3f8f4f; --c3: #8a4fa3; --good: #2e8b57; --look: #b7791f; --bad: #c0392b; }
@media (prefers-color-scheme: dark) {
  :root { --back: #16181b; --card: #1f2226; --ink: #e7e8e9; --soft: #9aa1a8; --line: #363b41;
          --c0: #7db1ee; --c1: #f0975f; --c2: #7fcb8e; --c3: #c79adb; --good: #63c08c; --look: #e0a94e; --bad: #ee7a6c; } }
* { box-sizing: border-box; }
body { margin: 0; background: var(--back); color: var(--ink); font: 15px/1.45 system-ui, "Segoe UI", "DejaVu Sans", sans-serif; }
main { max-width: 1240px; margin: 0 auto; padding: 28px 24px 60px; }
h1 { font-size: 26px; font-weight: 650; margin: 0 0 2px; overflow-wrap: anywhere; }
h2 { font-size: 17px; font-weight: 650; margin: 40px 0 10px; padding-top: 14px; border-top: 1px solid var(--line); }
h3 { font-size: 14.5px; font-weight: 650; margin: 22px 0 6px; }
pre { background: var(--card); border: 1px solid var(--line); border-radius: 6px; padding: 10px 12px; white-space: pre-wrap; overflow-wrap: anywhere; font-size: 13px; }
details { margin: 14px 0; } summary { cursor: pointer; color: var(--soft); }
p { color: var(--soft); margin: 4px 0 12px; max-width: 80ch; }
.lead { font-size: 16px; margin-bottom: 20px; max-width: none; }
.cards { display: grid; grid-template-columns: repeat(auto-fill, minmax(215px, 1fr)); gap: 12px; }
.card { background: var(--card); border: 1px solid var(--line); border-radius: 8px; padding: 12px 14px; }
.card .name { color: var(--soft); font-size: 12.5px; }
.card .value { font-size: 22px; font-weight: 600; font-variant-numeric: tabular-nums; margin: 2px 0; }
.card .note { color: var(--soft); font-size: 12.5px; }
.findings { list-style: none; padding: 0; margin: 18px 0 0; display: grid; gap: 6px; }
.findings li { border-left: 4px solid var(--good); background: var(--card); border-radius: 0 6px 6px 0; padding: 7px 12px; }
.findings .look { border-color: var(--look); } .findings .bad { border-color: var(--bad); }
.findings li::before { font-weight: 600; margin-right: 7px; }
.findings .good::before { content: "\2713"; color: var(--good); } .findings .look::before { content: "Look:"; color: var(--look); }
.findings .bad::before { content: "Problem:"; color: var(--bad); }
.gallery { display: grid; grid-template-columns: repeat(auto-fill, minmax(min(100%, 480px), 1fr)); gap: 26px 32px; }
.wide.gallery { grid-template-columns: 1fr; gap: 30px; }
.flat.gallery { grid-template-columns: repeat(auto-fill, minmax(min(100%, 320px), 1fr)); gap: 22px; }
figure { margin: 0; break-inside: avoid; }
figcaption { margin-bottom: 6px; line-height: 1.35; }
figcaption span { color: var(--soft); font-size: 13px; }
.flat figcaption span { display: block; min-height: 1.35em; } .gallery:not(.flat) figcaption span { margin-left: 4px; }
.panels { display: flex; gap: 10px; align-items: flex-start; }
.panels > div { min-width: 0; }
.frame { position: relative; line-height: 0; }
.frame img { width: 100%; height: auto; border-radius: 3px; }
img.pixels { image-rendering: pixelated; }
.overlay { position: absolute; inset: 0; width: 100%; height: 100%; overflow: hidden; }
.overlay path { fill: none; stroke-width: 1.1; stroke-linecap: round; vector-effect: non-scaling-stroke; }
.lines path { stroke: #ffd23e; stroke-opacity: .85; } .arrows path { stroke: #fff; stroke-width: 1.3; filter: drop-shadow(0 0 1px #0008); }
.landmarks { stroke: #ffd23e; } .landmarks circle { fill: none; stroke-width: 1.6; vector-effect: non-scaling-stroke; } .landmarks .dot { fill: inherit; stroke: none; } .landmarks path { stroke-width: 1.8; }
.interface path { stroke-width: 2.4; } .interface .face { stroke: none; fill-opacity: .35; }
.plane { color: var(--soft); font-size: 12px; text-align: center; margin-top: 3px; }
.side { position: absolute; font-size: 11px; line-height: 1; color: #fff; background: #0009; border-radius: 3px; padding: 2px 3px; }
.side.left { left: 3px; top: 50%; translate: 0 -50%; } .side.right { right: 3px; top: 50%; translate: 0 -50%; }
.side.top { top: 3px; left: 50%; translate: -50% 0; } .side.bottom { bottom: 3px; left: 50%; translate: -50% 0; }
.sheet { display: block; max-width: 100%; height: auto; border-radius: 6px; }
[hidden] { display: none !important; }
.views { display: flex; flex-wrap: wrap; gap: 6px; margin-bottom: 12px; }
.views button { font: inherit; font-size: 13.5px; color: var(--ink); background: var(--card); border: 1px solid var(--line); border-radius: 6px; padding: 4px 11px; cursor: pointer; }
.views button[aria-pressed=true] { background: var(--c0); border-color: var(--c0); color: var(--card); }
canvas { display: block; width: 100%; border-radius: 3px; cursor: crosshair; image-rendering: pixelated; }
#viewer .frame i { position: absolute; pointer-events: none; background: #fff6; }
#viewer .upright, #viewer .sweep { top: 0; bottom: 0; width: 1px; } #viewer .level { left: 0; right: 0; height: 1px; }
#viewer .sweep { display: none; background: #ffd23e !important; width: 2px !important; } #viewer.wiping .sweep { display: block; }
#viewer label { display: flex; gap: 10px; align-items: center; } #viewer input { flex: 1; min-width: 60px; accent-color: var(--c0); }
.flat-viewer .panels { max-width: 640px; }
.below { min-height: 56px; margin-top: 8px; font-size: 13px; color: var(--soft); display: flex; flex-wrap: wrap; gap: 4px 28px; align-items: center; }
.below > div { flex: 1 1 340px; } .readout { font-variant-numeric: tabular-nums; }
.bar { margin-top: 8px; max-width: 420px; font-size: 12px; color: var(--soft); line-height: 1.2; }
.bar img { display: block; width: 100%; height: 10px; border-radius: 2px; }
.bar > div { display: flex; justify-content: space-between; margin-top: 3px; }
.bar > div.unit { justify-content: center; margin-top: 1px; }
.charts { margin-bottom: 14px; display: grid; grid-template-columns: repeat(auto-fill, minmax(330px, 1fr)); gap: 16px; }
.chart { width: 100%; height: auto; background: var(--card); border: 1px solid var(--line); border-radius: 8px; break-inside: avoid; }
.chart text { fill: var(--ink); font-size: 11px; } .chart .tick, .chart .label { fill: var(--soft); font-size: 10.5px; }
.chart .chart-title { font-size: 12.5px; font-weight: 600; }
.chart .rule { stroke: var(--line); } .curve { fill: none; stroke-width: 1.8; stroke-linejoin: round; }
.curve0 { stroke: var(--c0); } .curve1 { stroke: var(--c1); stroke-dasharray: 5 3; }
.curve2 { stroke: var(--c2); stroke-dasharray: 1.5 2.5; } .curve3 { stroke: var(--c3); stroke-dasharray: 8 2 2 2; }
.columns .chart { max-width: 440px; margin-top: 10px; }
.columns { display: grid; grid-template-columns: repeat(auto-fit, minmax(min(100%, 380px), 1fr)); gap: 8px 32px; align-items: start; }
.scroll { overflow-x: auto; } table { border-collapse: collapse; width: 100%; font-size: 13.5px; font-variant-numeric: tabular-nums; }
th { text-align: right; font-weight: 600; color: var(--soft); border-bottom: 1px solid var(--line); padding: 5px 7px; }
td { text-align: right; border-bottom: 1px solid var(--line); padding: 4px 7px; white-space: nowrap; }
th:first-child, td:first-child { text-align: left; padding-left: 0; } td:first-child { white-space: normal; }
.narrow { max-width: 480px; margin-bottom: 14px; }
.settings td:last-child { white-space: normal; text-align: left; color: var(--soft); } .settings th:last-child { text-align: left; }
.inputs td:last-child { white-space: normal; overflow-wrap: anywhere; font-size: 11.5px; color: var(--soft); min-width: 180px; }
footer { margin-top: 40px; color: var(--soft); font-size: 12.5px; }
@media (max-width: 700px) {
  main { padding: 18px 14px 40px; } .panels { flex-wrap: wrap; } .panels > div { flex: 1 1 100% !important; }
  .cards { grid-template-columns: repeat(2, minmax(0, 1fr)); } .card .value { font-size: 18px; } }
@media print {
  #viewer, details { display: none; }
  :root { color-scheme: light; --back: #fff; --card: #fff; --ink: #000; --soft: #444; --line: #bbb;
          --c0: #1f5fa8; --c1: #c2541b; --c2: #3f8f4f; --c3: #8a4fa3; }
  body { font-size: 10.5pt; } main { max-width: none; padding: 0; }
  h2, h3, h2 + p, h3 + p { break-after: avoid; } h2 { margin-top: 22px; } tr, p, .card, .findings li, .columns { break-inside: avoid; }
  .scroll { overflow: visible; } table { font-size: 7.5pt; } th, td { padding: 2px 4px; white-space: normal; }
  .inputs td:last-child { font-size: 6.5pt; } .wide.gallery { display: block; } .wide.gallery figure { margin-bottom: 18px; }
  * { print-color-adjust: exact; -webkit-print-color-adjust: exact; } }
)css";

}  // namespace saltus::drawing
