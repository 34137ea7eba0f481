// Draws the page's charts, fills their tables and applies the filters.
"use strict";

const report = JSON.parse(document.getElementById("report").textContent);
for (const figure of report.figures) {
    figure.rows = figure.rows.map((row) => Object.fromEntries(row.map((value, index) => [figure.keys[index], value])));
}
// Marks are hidden from screen readers, which read the table below the chart, and the page's filters replace legends.
const config = {...report.config, aria: true, mark: {aria: false}, legend: {disable: true}};
const scene = document.getElementById("scene");
const boxes = [...document.querySelectorAll("#filters input[type=checkbox]")];
const views = [];  // a {figure, panel, element, view} for each chart

const shownBackends = () => boxes.filter((box) => box.checked).map((box) => box.value);
const matches = (row, match) => Object.entries(match).every(([key, value]) => row[key] === value);
const passes = (row, shown) => shown.has(row.backend) && (scene.value === "" || row.scene === scene.value);

function cellText(value, digits) {
    if (value === null || value === undefined) return "–";
    if (digits === null || typeof value !== "number") return String(value);
    const size = Math.abs(value);
    if (size !== 0 && (size < 1e-3 || size >= 1e7)) return value.toExponential(Math.min(digits, 4) - 1);
    return String(Number(value.toPrecision(digits)));
}

function fillTable(details) {
    const figure = report.figures.find((candidate) => candidate.name === details.dataset.figure);
    const shown = new Set(shownBackends());
    const rows = figure.rows.filter((row) => passes(row, shown));
    const table = document.createElement("table");
    const head = table.createTHead().insertRow();
    for (const [, label, digits] of figure.columns) {
        const cell = document.createElement("th");
        cell.scope = "col";
        cell.textContent = label;
        if (digits !== null) cell.className = "number";
        head.append(cell);
    }
    const body = table.createTBody();
    for (const row of rows) {
        const line = body.insertRow();
        for (const [key, , digits] of figure.columns) {
            const cell = line.insertCell();
            cell.textContent = cellText(row[key], digits);
            if (digits !== null) cell.className = "number";
        }
    }
    details.querySelector(".scroll").replaceChildren(table);
}

function applyFilters() {
    const shown = shownBackends();
    const set = new Set(shown);
    for (const {figure, panel, element, view} of views) {
        const rows = figure.rows.filter((row) => matches(row, panel.match) && passes(row, set));
        element.closest("figure").hidden = rows.length === 0;
        if (rows.length === 0) continue;
        view.signal("shown", shown).signal("scene", scene.value);
        if (panel.step) view.height(panel.step[1] * new Set(rows.map((row) => row[panel.step[0]])).size);
        view.runAsync();
    }
    for (const section of document.querySelectorAll("section[data-figure]")) {
        section.querySelector(".empty").hidden = section.querySelector("figure:not([hidden])") !== null;
    }
    for (const row of document.querySelectorAll("tr[data-scene], .pair[data-scene]")) {
        row.hidden = scene.value !== "" && row.dataset.scene !== scene.value;
    }
    document.querySelectorAll("details[data-figure][open]").forEach(fillTable);
}

async function draw() {
    for (const figure of report.figures) {
        for (const [index, panel] of figure.panels.entries()) {
            const element = document.getElementById(`${figure.name}-${index}`);
            const rows = figure.rows.filter((row) => matches(row, panel.match));
            const spec = {...panel.spec, datasets: {...panel.spec.datasets, rows}};
            const options = {renderer: "svg", actions: false, ast: true, config, tooltip: {theme: "custom"}};
            const {view} = await vegaEmbed(element, spec, options);
            views.push({figure, panel, element, view});
        }
    }
    applyFilters();
    document.documentElement.dataset.drawn = "yes";
}

document.getElementById("filters").addEventListener("change", applyFilters);
document.getElementById("all").addEventListener("click", () => {
    const every = boxes.every((box) => box.checked);
    boxes.forEach((box) => { box.checked = !every; });
    applyFilters();
});
for (const details of document.querySelectorAll("details[data-figure]")) {
    details.addEventListener("toggle", () => { if (details.open) fillTable(details); });
}
draw();
