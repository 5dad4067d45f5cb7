// The legend of the 3D view: what the colors of the bodies mean now.

function showLegend(list, data, skin, isShown) {
  const dotted = ({ label, color }) => {
    const dot = element("span", { className: "dot" });
    dot.style.background = cssColor(color);
    return element("li", {}, dot, label);
  };
  const soft = textContent => element("li", { className: "soft", textContent });
  const rows = {
    photo: () => [soft(data.guessed)],
    neutral: () => [],
    contact: () => (data.legend.length
      ? [soft("Contact with"), ...data.legend.map(dotted), ...(data.faint ? [soft(data.faint)] : [])] : []),
  }[skin]();
  list.hidden = !rows.length || !isShown;
  list.replaceChildren(...rows);
}
