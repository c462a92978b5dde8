"use strict";
const at = (id) => document.getElementById(id);
const COLOURS = ["#4dbf59", "#f28c33", "#d95999", "#f2d94d"];
const canvas = at("plane");
const drawing = canvas.getContext("2d");
const paper = document.createElement("canvas");
paper.width = canvas.width;
paper.height = canvas.height;
const lines = paper.getContext("2d");
lines.lineCap = "round";
let scale = 45;

function px(x, y) {
  return [x * scale, canvas.height - y * scale];
}

function addLines(pieces) {
  for (const [x0, y0, x1, y1, r, g, b, width] of pieces) {
    lines.strokeStyle = `rgb(${r} ${g} ${b})`;
    lines.lineWidth = width;
    lines.beginPath();
    lines.moveTo(...px(x0, y0));
    lines.lineTo(...px(x1, y1));
    lines.stroke();
  }
}

function oval(x, y, long, wide) {
  drawing.beginPath();
  drawing.ellipse(x, y, long, wide, 0, 0, 2 * Math.PI);
  drawing.fill();
}

function drawTurtle(turtle, number) {
  const [x, y] = px(turtle.x, turtle.y);
  drawing.save();
  drawing.translate(x, y);
  drawing.rotate(-turtle.theta);
  drawing.fillStyle = "#8a6d3b";
  for (const [along, across] of [[10, 11], [10, -11], [-10, 11], [-10, -11]]) oval(along, across, 5, 3.5);
  oval(17, 0, 6, 4.5);
  drawing.fillStyle = COLOURS[number % COLOURS.length];
  oval(0, 0, 14, 11);
  drawing.restore();
  drawing.fillStyle = "white";
  drawing.font = "12px system-ui, sans-serif";
  drawing.textAlign = "center";
  drawing.fillText(turtle.name, x, y - 20);
}

function cell(text) {
  const made = document.createElement("td");
  made.textContent = text;
  return made;
}

function showTable(turtles, scores, asked) {
  const head = document.createElement("tr");
  for (const title of ["Turtle", "x, y (m)", "m/s", "Score", ""]) {
    const made = document.createElement("th");
    made.textContent = title;
    head.append(made);
  }
  at("turtles").replaceChildren(head, ...turtles.map((turtle) => {
    const row = document.createElement("tr");
    const score = scores[turtle.name];
    row.append(cell(turtle.name), cell(turtle.x.toFixed(2) + ", " + turtle.y.toFixed(2)), cell(turtle.speed.toFixed(2)),
      cell(score === null || score === undefined ? "" : score.toFixed(2)), cell(turtle.wall ? "at the wall" : turtle.name in asked ? "slowed" : ""));
    row.title = asked[turtle.name] || "";
    return row;
  }));
}

function came(state) {
  if (state.op !== "state") return;
  scale = canvas.width / state.side;
  if (state.wipe) lines.clearRect(0, 0, paper.width, paper.height);
  addLines(state.lines);
  drawing.fillStyle = `rgb(${state.background.join(" ")})`;
  drawing.fillRect(0, 0, canvas.width, canvas.height);
  drawing.drawImage(paper, 0, 0);
  state.turtles.forEach(drawTurtle);
  showTable(state.turtles, state.scores, state.asked);
}

function connect() {
  const socket = new WebSocket(location.href.replace(/^http/, "ws").replace(/[?#].*$/, "").replace(/\/[^/]*$/, "/feed"));
  socket.addEventListener("message", (event) => came(JSON.parse(event.data)));
  socket.addEventListener("open", () => {
    lines.clearRect(0, 0, paper.width, paper.height);
    at("connection").textContent = "live";
    at("connection").className = "badge good";
  });
  socket.addEventListener("close", () => {
    at("connection").textContent = "not connected";
    at("connection").className = "badge bad";
    setTimeout(connect, 1000);
  });
}
connect();
