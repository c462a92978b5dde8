"use strict";
// The drawing itself holds all there is to know: who is who in data-id, who is linked in data-from and data-to.
(() => {
  const drawing = document.getElementById("drawing");
  const world = document.getElementById("world");
  const about = document.getElementById("about");
  const search = document.getElementById("search");
  const hitCount = document.getElementById("hits");
  const vertices = new Map();
  const arrows = [];
  for (const element of world.querySelectorAll(".vertex")) {
    const rect = element.querySelector("rect");
    const at = (name) => Number(rect.getAttribute(name));
    vertices.set(element.dataset.id, {
      id: element.dataset.id, element, name: element.dataset.name, detail: element.dataset.detail,
      isTopic: element.classList.contains("topic"), incoming: [], outgoing: [],
      middle: [at("x") + at("width") / 2, at("y") + at("height") / 2],
    });
  }
  for (const element of world.querySelectorAll(".arrow")) {
    const arrow = { element, from: vertices.get(element.dataset.from), to: vertices.get(element.dataset.to) };
    arrow.from.outgoing.push(arrow);
    arrow.to.incoming.push(arrow);
    arrows.push(arrow);
  }
  const [, , fullWidth, fullHeight] = drawing.getAttribute("viewBox").split(" ").map(Number);
  drawing.removeAttribute("viewBox");
  if (arrows.length > 120) drawing.classList.add("many");

  // -- where we look ---------------------------------------------------------------------------
  let scale = 1, left = 0, top = 0, asked = false;
  const show = () => {
    if (asked) return;
    asked = true;
    requestAnimationFrame(() => {
      asked = false;
      world.setAttribute("transform", `translate(${left} ${top}) scale(${scale})`);
      drawing.classList.toggle("far", scale < 0.38);
    });
  };
  const fit = () => {
    const { width, height } = drawing.getBoundingClientRect();
    scale = Math.min(1.4, width / fullWidth, height / fullHeight) || 1;
    left = (width - fullWidth * scale) / 2;
    top = (height - fullHeight * scale) / 2;
    show();
  };
  const zoom = (factor, x, y) => {
    const wanted = Math.min(6, Math.max(0.01, scale * factor));
    left = x - (x - left) * wanted / scale;
    top = y - (y - top) * wanted / scale;
    scale = wanted;
    show();
  };
  const zoomMiddle = (factor) => {
    const { width, height } = drawing.getBoundingClientRect();
    zoom(factor, width / 2, height / 2);
  };
  const goTo = (vertex) => {
    const { width, height } = drawing.getBoundingClientRect();
    scale = Math.max(scale, 0.8);
    left = width / 2 - vertex.middle[0] * scale;
    top = height / 2 - vertex.middle[1] * scale;
    show();
  };
  drawing.addEventListener("wheel", (event) => {
    event.preventDefault();
    const box = drawing.getBoundingClientRect();
    const step = event.deltaMode === 1 ? event.deltaY * 16 : event.deltaY;
    zoom(Math.exp(-step / 500), event.clientX - box.left, event.clientY - box.top);
  }, { passive: false });

  const pointers = new Map();
  let dragged = 0, pressedOn = null;
  drawing.addEventListener("pointerdown", (event) => {
    if (event.button) return;
    if (!pointers.size) { dragged = 0; pressedOn = event.target.closest(".vertex"); }
    pointers.set(event.pointerId, [event.clientX, event.clientY]);
    drawing.setPointerCapture(event.pointerId);
  });
  drawing.addEventListener("pointermove", (event) => {
    const before = pointers.get(event.pointerId);
    if (!before) return;
    const dx = event.clientX - before[0], dy = event.clientY - before[1];
    const other = [...pointers].filter(([id]) => id !== event.pointerId).map(([, place]) => place)[0];
    if (other) {
      const far = (place) => Math.hypot(place[0] - other[0], place[1] - other[1]) || 1;
      const box = drawing.getBoundingClientRect();
      zoom(far([event.clientX, event.clientY]) / far(before), other[0] - box.left, other[1] - box.top);
    } else {
      left += dx; top += dy;
      show();
    }
    dragged += Math.abs(dx) + Math.abs(dy);
    if (dragged > 4) drawing.classList.add("moving");
    pointers.set(event.pointerId, [event.clientX, event.clientY]);
  });
  const release = (event) => {
    if (!pointers.delete(event.pointerId) || pointers.size) return;
    drawing.classList.remove("moving");
    if (event.type === "pointerup" && dragged <= 4) {
      if (pressedOn) choose(vertices.get(pressedOn.dataset.id)); else forget();
    }
  };
  drawing.addEventListener("pointerup", release);
  drawing.addEventListener("pointercancel", release);

  // -- one vertex and its neighbours -----------------------------------------------------------
  // Beyond a topic come the nodes at its other end: the picture answers "who hears this node?".
  const reach = (vertex, links, end) => {
    const found = [];
    for (const arrow of vertex[links]) {
      found.push(arrow);
      if (!vertex.isTopic && arrow[end].isTopic) found.push(...arrow[end][links]);
    }
    return found;
  };
  const forget = () => {
    drawing.classList.remove("chosen");
    for (const { element } of vertices.values()) element.classList.remove("on", "here");
    for (const { element } of arrows) element.classList.remove("from", "to");
    about.hidden = true;
  };
  const choose = (vertex) => {
    forget();
    drawing.classList.add("chosen");
    vertex.element.classList.add("on", "here");
    const sides = [["from", "incoming", "from"], ["to", "outgoing", "to"]];
    const reached = sides.map(([mark, links, end]) => {
      const found = reach(vertex, links, end);
      for (const arrow of found) {
        arrow.element.classList.add(mark);
        arrow[end].element.classList.add("on");
      }
      return [mark, [...new Set(found.map((arrow) => arrow[end]))]];
    });
    describe(vertex, reached);
  };
  const add = (parent, tag, text) => {
    const element = document.createElement(tag);
    element.textContent = text;
    parent.append(element);
    return element;
  };
  const describe = (vertex, reached) => {
    about.replaceChildren();
    add(about, "h2", vertex.name);
    add(about, "div", vertex.detail);
    for (const [mark, others] of reached) {
      const title = add(about, "h3", `${mark === "from" ? "comes from" : "goes to"} (${others.length})`);
      title.className = mark;
      const list = add(about, "ul", "");
      for (const other of others) {
        const button = add(add(list, "li", ""), "button", other.name);
        button.type = "button";
        button.addEventListener("click", () => { choose(other); goTo(other); });
      }
    }
    about.hidden = false;
  };
  drawing.addEventListener("keydown", (event) => {
    const element = event.target.closest(".vertex");
    if (element && (event.key === "Enter" || event.key === " ")) {
      event.preventDefault();
      choose(vertices.get(element.dataset.id));
    }
  });

  // -- search ----------------------------------------------------------------------------------
  let hits = [], next = 0;
  search.addEventListener("input", () => {
    const wanted = search.value.trim().toLowerCase();
    hits = [];
    next = 0;
    for (const vertex of vertices.values()) {
      const found = wanted !== "" && `${vertex.name}\n${vertex.detail}`.toLowerCase().includes(wanted);
      vertex.element.classList.toggle("hit", found);
      if (found) hits.push(vertex);
    }
    hitCount.textContent = wanted === "" ? "" : `${hits.length} found`;
    if (hits.length === 1) goTo(hits[0]);
  });
  document.getElementById("find").addEventListener("submit", (event) => {
    event.preventDefault();
    if (!hits.length) return;
    const vertex = hits[next % hits.length];
    next += 1;
    hitCount.textContent = `${(next - 1) % hits.length + 1} of ${hits.length}`;
    choose(vertex);
    goTo(vertex);
  });

  // -- keys and buttons ------------------------------------------------------------------------
  const moves = { "+": () => zoomMiddle(1.25), "-": () => zoomMiddle(0.8), 0: fit, Escape: forget,
    "/": () => search.focus() };
  document.addEventListener("keydown", (event) => {
    if (event.target === search) {
      if (event.key === "Escape") search.blur();
      return;
    }
    if (event.ctrlKey || event.metaKey || event.altKey || !Object.hasOwn(moves, event.key)) return;
    event.preventDefault();
    moves[event.key]();
  });
  document.getElementById("nearer").addEventListener("click", () => zoomMiddle(1.25));
  document.getElementById("farther").addEventListener("click", () => zoomMiddle(0.8));
  document.getElementById("fit").addEventListener("click", fit);
  for (const element of document.querySelectorAll(".scripted")) element.hidden = false;
  fit();
})();
