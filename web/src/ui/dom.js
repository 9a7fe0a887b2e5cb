// Elements and controls.

/** An element with attributes (functions are listeners) and children. */
export function el(name, attributes = {}, ...children) {
  const element = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) {
    if (typeof value === 'function') element.addEventListener(key, value);
    else if (value === true) element.setAttribute(key, '');
    else if (value !== false && value !== undefined) element.setAttribute(key, value);
  }
  element.append(...children);
  return element;
}

let unique = 0;

/** A group of buttons of which one is chosen: radio buttons, so that arrow keys move between them. */
export function segmented(label, options, chosen, change) {
  const name = `scene-choice-${unique++}`;
  const inputs = options.map((text, value) => {
    const input = el('input', { type: 'radio', name, value, change: () => change(value) });
    input.checked = value === chosen;
    return el('label', {}, input, el('span', {}, text));
  });
  const group = el('fieldset', { class: 'scene-segmented' }, el('legend', {}, label), el('div', {}, ...inputs));
  group.choose = (value) => { inputs[value].firstChild.checked = true; };
  return group;
}

/** A list to choose from: `options` are [value, text]. */
export function choice(label, options, chosen, change) {
  const select = el(
    'select',
    { 'aria-label': label, change: () => change(options[select.selectedIndex][0]) },
    ...options.map(([, text]) => el('option', {}, text)),
  );
  select.selectedIndex = Math.max(0, options.findIndex(([value]) => value === chosen));
  const field = el('label', { class: 'scene-field' }, el('span', {}, label), select);
  field.select = select;
  return field;
}

export function checkbox(label, checked, change) {
  const input = el('input', { type: 'checkbox', change: () => change(input.checked) });
  input.checked = checked;
  return el('label', { class: 'scene-check' }, input, label);
}

/** A slider with its value as text. */
export function slider(label, { min, max, step, value, text }, change) {
  const input = el('input', { type: 'range', 'aria-label': label, min, max, step });
  const shown = el('output', {}, '');
  const show = () => {
    shown.textContent = text(input.valueAsNumber);
    input.setAttribute('aria-valuetext', text(input.valueAsNumber));
  };
  input.addEventListener('input', () => { show(); change(input.valueAsNumber); });
  input.value = value;
  show();
  const field = el('label', { class: 'scene-field' }, el('span', {}, label), input, shown);
  field.set = (next) => { input.value = next; show(); };
  field.get = () => input.valueAsNumber;
  return field;
}

export function button(text, press, attributes = {}) {
  return el('button', { type: 'button', click: press, ...attributes }, text);
}
