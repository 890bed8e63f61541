// Runs axe-core on every page of a folder at 390 px, light and dark; prints a line each. Arguments: folder of pages, folder of node modules.
import { createRequire } from "module";
import { readFileSync, readdirSync } from "fs";
import { join } from "path";

const [pages, modules, browser] = process.argv.slice(2);
const require = createRequire(join(modules, "package.json"));
const puppeteer = require("puppeteer-core");
const axe = readFileSync(require.resolve("axe-core/axe.min.js"), "utf8");
const shown = await puppeteer.launch({ executablePath: browser, headless: true, args: ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"] });
let all = 0;
for (const file of readdirSync(pages).filter((name) => name.endsWith(".html")).sort()) {
  for (const scheme of ["light", "dark"]) {
    const page = await shown.newPage();
    await page.setBypassCSP(true);
    await page.setViewport({ width: 390, height: 844 });
    await page.emulateMediaFeatures([{ name: "prefers-color-scheme", value: scheme }]);
    await page.goto("file://" + join(pages, file));
    await page.evaluate(axe);
    const { violations } = await page.evaluate(() => globalThis.axe.run());
    const serious = violations.filter((v) => ["serious", "critical"].includes(v.impact));
    const count = serious.reduce((sum, v) => sum + v.nodes.length, 0);
    all += count;
    console.log(`${file} ${scheme}: ${count} serious${serious.map((v) => ` | ${v.id} ${v.nodes[0].target}`).join("")}`);
    await page.close();
  }
}
await shown.close();
console.log(`${all} serious findings`);
process.exit(all ? 1 : 0);
