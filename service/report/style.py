"""The style of a report: dark or light, by the setting of the reader's system."""

STYLE = """\
:root {
  color-scheme: light dark;
  --ground: #ffffff; --text: #1d232b; --quiet: #56606c; --line: #d5dbe2; --panel: #f3f5f8;
}
@media (prefers-color-scheme: dark) {
  :root { --ground: #14181d; --text: #e6eaef; --quiet: #a3adb8; --line: #37404a; --panel: #1e242b; }
}
body { margin: 0; background: var(--ground); color: var(--text); font: 16px/1.5 system-ui, sans-serif; }
main { max-width: 46rem; margin: 0 auto; padding: 1rem 1rem 4rem; }
h1, h2, td, figcaption { overflow-wrap: anywhere; }
h1 { font-size: 1.6rem; }
h2 { font-size: 1.2rem; margin-top: 2.5rem; }
section { break-inside: avoid; }
figure { margin: 1rem 0; padding: 0.5rem; background: var(--panel); border-radius: 0.5rem; }
figure img { max-width: 100%; height: auto; }
.pair { display: flex; flex-wrap: wrap; justify-content: space-around; }
.pair img { flex: 0 1 16rem; min-width: 8rem; }
.pair figcaption { flex-basis: 100%; }
figcaption, caption { color: var(--quiet); font-size: 0.9rem; text-align: left; }
table { border-collapse: collapse; width: 100%; margin: 1rem 0; }
th, td { border-top: 1px solid var(--line); padding: 0.25rem 0.75rem 0.25rem 0; }
th, td { text-align: left; vertical-align: top; }
th { font-weight: 600; width: 12rem; }
.numbers td { font-variant-numeric: tabular-nums; }
dt { font-weight: 600; }
dd { margin: 0 0 0.75rem; }
"""
