// The text beside the view: people, remarks, checks, licenses.

const STATE_CLASS = { failed: "bad", unknown: "doubtful", ok: "good" };

function showPeople(section, data, selected, onSelect) {
  const chips = data.people.map((person, index) => {
    const dot = element("span", { className: "dot" });
    dot.style.background = cssColor(person.color);
    const button = element("button", { type: "button", "aria-pressed": String(index === selected) },
      dot, `Person ${index}`);
    button.addEventListener("click", () => onSelect(index === selected ? null : index));
    return button;
  });
  const title = data.people.length === 0 ? "No people detected" : "People";
  const advice = selected === null && chips.length
    ? element("p", { className: "soft", textContent: "Choose a person here, or click on one." }) : null;
  const missing = data.unposed.length
    ? element("ul", {}, ...data.unposed.map(one => element("li", { textContent: `No body: ${one.reason} (dashed box)` }))) : null;
  section.replaceChildren(...[
    element("h2", { textContent: title }), element("div", { className: "chips" }, ...chips), advice,
    selected === null ? null : personCard(data, selected), missing].filter(Boolean));
}

function personCard(data, index) {
  const person = data.people[index], card = element("div", {});
  const heading = element("div", { className: "row" }, element("h2", { textContent: `Person ${index}` }),
    element("span", { textContent: person.marks }));
  const checks = data.checks.filter(check => check.person === index);
  const why = checks.some(check => check.state === "failed") ? [] : [element("p", {}, ...withOptions(person.why))];
  card.append(heading, ...why, ...checkList(checks));
  if (!person.posed) {
    card.append(element("p", { textContent: "This person has no body: a backend returned no finite values." }));
  } else {
    const seen = [
      ["Posture", person.posture_probability >= .5 && `${person.posture}, ${person.posture_probability.toFixed(2)}`],
      ["Probability of a child", person.child_probability?.toFixed(2)],
      ["Uncertain", person.unsure],
      ["Given body", person.body_source],
    ].filter(([, value]) => value);
    card.append(facts([
      ...seen,
      ["Stature", meters(person.stature, person.stature_sigma)],
      ["To the camera (pelvis)", meters(person.camera, person.distance_sigma)],
      ["Pelvis over the floor", data.floor ? meters(person.pelvis_height, data.scale_sigma) : "no floor"],
      ["Lowest point over the floor", data.floor ? meters(person.lowest) : "no floor"],
    ]));
    if (person.others.length) {
      card.append(element("h3", { textContent: "Distances to other people" }), table(
        ["", "of pelvises", "of surfaces"],
        person.others.map(other => [`person ${other.person}`, meters(other.pelvis, data.distance_sigma), meters(other.gap, data.distance_sigma)]),
        ["of pelvises", "of surfaces"]));
    }
    if (person.support) card.append(element("h3", { textContent: "Support" }), element("p", { textContent: person.support }));
    card.append(element("h3", { textContent: "Contact and its probability" }), ...partnerRows(person), ...contactRows(person));
  }
  return card;
}

// What each body part touches, and its probability.
function partnerRows(person) {
  if (!person.contacts.length) return [];
  const rows = person.contacts.map(({ part, partner, color, probability, far }) => {
    const dot = element("span", { className: "dot" });
    dot.style.background = cssColor(color);
    const sure = probability === null ? "" : `, ${probability.toFixed(2)}`;
    return element("li", {}, dot, `${part}: ${partner}${far && ` (${far})`}${sure}`);
  });
  const list = chosen => element("ul", { className: "partners" }, ...rows.filter((row, i) => chosen(person.contacts[i])));
  const apart = (title, chosen) => person.contacts.some(chosen)
    ? [element("div", { className: "soft possible" }, element("h3", { textContent: title }), list(chosen))]
    : [];
  return [
    list(contact => contact.likely && !contact.assumed),
    ...apart("Assumed: the photo does not show these parts", contact => contact.likely && contact.assumed),
    ...apart("Possible contact, probability below 0.5", contact => !contact.likely),
  ];
}

function contactRows(person) {
  if (!person.contact_vertices) return [element("p", { className: "soft", textContent: "No contact." })];
  const total = `${person.contact_vertices} of ${person.vertices} vertices touch`;
  if (!person.contact) {
    return [element("p", { textContent: `${total}. Body parts are unknown: the body model is not available.` })];
  }
  const rows = person.contact.map(({ part, cm2, share, colors }) => {
    const fills = colors.map(one => {
      const fill = element("b", {});
      fill.style.width = `${100 * one.share}%`;
      fill.style.background = cssColor(one.color);
      return fill;
    });
    return element("div", { className: "bar" },
      element("span", { textContent: part }), element("i", { title: `${percent(share)} of this part` }, ...fills),
      element("span", { textContent: `${cm2.toFixed(0)} cm²` }));
  });
  return [element("h3", { textContent: "Area in contact" }), ...rows, element("p", { className: "soft", textContent: `${total}. The bars show the share of each part.` })];
}

function facts(pairs) {
  return element("dl", {}, ...pairs.flatMap(([name, value]) => [
    element("dt", { textContent: name }), element("dd", { textContent: value })]));
}

// Rows of text; the columns named in ``right`` are numbers.
function table(names, rows, right) {
  const kind = column => (right.includes(names[column]) ? "number" : "");
  return element("table", {},
    element("thead", {}, element("tr", {}, ...names.map((name, i) => element("th", { className: kind(i), textContent: name, scope: "col" })))),
    element("tbody", {}, ...rows.map(row =>
      element("tr", {}, ...row.map((cell, i) => element("td", { className: kind(i), textContent: cell }))))));
}

// Failed checks; those that were not measured and those that are ok are folded.
function checkList(checks) {
  const rows = state => checks.filter(check => check.state === state).map(checkRow);
  const folded = (state, name) => rows(state).length
    ? element("details", {}, element("summary", { textContent: `${rows(state).length} ${name}` }), ...rows(state)) : null;
  return [...rows("failed"), folded("unknown", "not measured"), folded("ok", "ok")].filter(Boolean);
}

// Label, value and bound; the name in the code is the tooltip.
function checkRow(check) {
  const value = element("span", { className: STATE_CLASS[check.state], textContent: check.value });
  const bound = check.state === "unknown" ? null : element("span", { className: "soft", textContent: `, ${check.bound}` });
  const why = check.message ? element("p", {}, ...withOptions(check.message)) : null;
  return element("div", { className: "check", title: check.name }, `${check.label}: `, value, bound, why);
}

function showRemarks(section, data) {
  const list = texts => element("ul", {}, ...texts.map(text => element("li", {}, ...withOptions(text))));
  section.replaceChildren(...[
    data.warnings.length ? element("h2", { className: "bad", textContent: "Warnings" }) : null,
    data.warnings.length ? list(data.warnings) : null,
    data.notes.length ? element("h3", { textContent: "Notes" }) : null,
    data.notes.length ? list(data.notes) : null].filter(Boolean));
}

function showChecks(section, data) {
  const checks = data.checks.filter(check => check.person === null);
  if (!checks.length) return;
  section.replaceChildren(
    element("h2", { textContent: "Checks of the photo" }),
    element("p", { className: "soft", textContent: `With those of the people: ${data.checked}` }), ...checkList(checks));
}

function showLicenses(section, { licenses }) {
  if (!licenses.length) return;
  section.replaceChildren(element("details", {}, element("summary", { textContent: "Licenses of the weights" }),
    element("ul", {}, ...licenses.map(text => element("li", { textContent: text })))));
}
