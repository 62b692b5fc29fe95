// What is brushed in one view lights up in all: rows in loop, time and residual, cells on the plane.
//
// A brush gives a rectangle of one view, or a stretch of time from the slider.  Rows are found here,
// in the browser, so that a brush need not wait for the server.  On the Preisach plane a row stands
// for the cells whose hysterons it switches: while the input rises, those of its α between its β and
// the turning point from which its branch departs; while it falls, those of its β.

const rows = source.data
const count = rows.time.length
const levels = edges.length - 1
const MOST_SHOWN = 2000

function rows_inside(x, y, box) {
  const found = []
  for (let k = 0; k < count; k++) {
    if (x[k] >= box.x0 && x[k] <= box.x1 && y[k] >= box.y0 && y[k] <= box.y1) found.push(k)
  }
  return found
}

// Positions on the plane run from 0 to the number of levels.
function input_at(position) {
  const cell = Math.min(Math.max(Math.floor(position), 0), levels - 1)
  return edges[cell] + (position - cell) * (edges[cell + 1] - edges[cell])
}

function position_on(input) {
  let cell = 0
  while (cell < levels - 1 && input >= edges[cell + 1]) cell++
  return cell + (input - edges[cell]) / (edges[cell + 1] - edges[cell])
}

function rows_that_switch(box) {
  // β lies on x and α on y.
  const [beta0, beta1, alpha0, alpha1] = [box.x0, box.x1, box.y0, box.y1].map(position_on)
  const found = []
  for (let k = 1; k < count; k++) {
    const [now, before, other] = [rows.position[k], rows.position[k - 1], rows.departure[k]]
    const rises = now > before && now >= alpha0 && before < alpha1
    const falls = now < before && now <= beta1 && before > beta0
    if (rises && other <= beta1 && now >= beta0) found.push(k)
    else if (falls && other >= alpha0 && now <= alpha1) found.push(k)
  }
  return found
}

function switched_cells(chosen) {
  const seen = new Uint8Array(levels * levels)
  const cell = (value) => Math.min(Math.max(Math.floor(value), 0), levels - 1)
  for (const k of chosen) {
    if (k === 0) continue
    const [now, before, other] = [rows.position[k], rows.position[k - 1], rows.departure[k]]
    if (now > before) {
      for (let i = cell(before); i <= cell(now); i++) {
        for (let j = cell(other); j <= i; j++) seen[i * levels + j] = 1
      }
    } else if (now < before) {
      for (let j = cell(now); j <= cell(before); j++) {
        for (let i = j; i <= cell(other); i++) seen[i * levels + j] = 1
      }
    }
  }
  const [x, y, width, height] = [[], [], [], []]
  for (let i = 0; i < levels; i++) {
    for (let j = 0; j <= i; j++) {
      if (seen[i * levels + j]) {
        x.push((edges[j] + edges[j + 1]) / 2)
        y.push((edges[i] + edges[i + 1]) / 2)
        width.push(edges[j + 1] - edges[j])
        height.push(edges[i + 1] - edges[i])
      }
    }
  }
  return { x, y, width, height }
}

function staircase_at(row) {
  // Nested extremes, in turn least and greatest; those that the input has passed are wiped out.
  const extremes = [0]
  for (let k = 0; k <= row; k++) {
    const now = rows.position[k]
    const last = extremes.length - 1
    if (now === extremes[last]) continue
    const rises = now > extremes[last]
    const is_greatest = last % 2 === 1
    if (rises === is_greatest) extremes[last] = now
    else extremes.push(now)
    let end = extremes.length - 1
    while (end >= 2 && (end % 2 ? now >= extremes[end - 2] : now <= extremes[end - 2])) {
      extremes.splice(end - 2, 2)
      end -= 2
    }
  }
  const [x, y] = [[], []]
  const corner = (beta, alpha) => {
    x.push(input_at(beta))
    y.push(input_at(alpha))
  }
  for (let k = 1; k < extremes.length; k += 2) {
    corner(extremes[k - 1], extremes[k])
    if (k + 1 < extremes.length) corner(extremes[k + 1], extremes[k])
  }
  const now = extremes[extremes.length - 1]
  corner(now, now)
  return { x, y }
}

function fill(drawn, data) {
  // The server need not know; it takes longer to tell it than to draw.
  drawn.setv({ data }, { sync: false })
}

function say(sentence, is_marked) {
  // In its place, as a change of the text would lay out the whole page.
  told.setv({ text: sentence }, { silent: true })
  const view = Bokeh.index.find_one(told)
  if (!view) return
  const mark = document.createElement("span")
  mark.style = `display: ${is_marked ? "inline-block" : "none"}; width: 0.7em; height: 0.7em; ` +
    `margin-right: 0.4em; border-radius: 50%; background: ${colour}`
  view.markup_el.replaceChildren(mark, sentence)
}

function light_up(chosen) {
  const step = Math.max(Math.ceil(chosen.length / MOST_SHOWN), 1)
  const shown = chosen.filter((_, place) => place % step === 0)
  const data = {}
  for (const name of Object.keys(highlight.data)) {
    data[name] = Float64Array.from(shown, (k) => rows[name][k])
  }
  fill(highlight, data)
  fill(cells, switched_cells(chosen))
  const last = chosen.length ? chosen[chosen.length - 1] : count - 1
  fill(staircase, staircase_at(last))
  if (chosen.length) {
    const [begin, end] = [chosen[0], last].map((k) => rows.time[k].toPrecision(4))
    const count = chosen.length.toLocaleString("en")
    say(`${count} rows chosen, ${begin} to ${end} s, and the cells that they switch; the staircase ` +
      "is the memory at the last", true)
  } else {
    say("Drag over any view to choose rows; what is chosen lights up in all. The staircase is the " +
      "memory at the end.", false)
  }
  // The server computes the spectrum of the rows from their first to their last.
  if (chosen.length || stretch.data.first.length) {
    stretch.data = chosen.length ? { first: [chosen[0]], last: [last] } : { first: [], last: [] }
  }
}

if (view === "slider") {
  const [begin, end] = cb_obj.value
  const whole = begin <= cb_obj.start && end >= cb_obj.end
  light_up(whole ? [] : rows_inside(rows.time, rows.time, { x0: begin, x1: end, y0: begin, y1: end }))
} else if (view === "nothing") {
  light_up([])
} else if (cb_obj.final && cb_obj.geometry.type === "rect") {
  const box = cb_obj.geometry
  if (view === "plane") light_up(rows_that_switch(box))
  else if (view === "loop") {
    const measured = rows_inside(rows.input, rows.output, box)
    light_up(measured.length ? measured : rows_inside(rows.input, rows.model, box))
  } else if (view === "time") light_up(rows_inside(rows.time, rows.time, { ...box, y0: box.x0, y1: box.x1 }))
  else light_up(rows_inside(rows.axis, rows.residual, box))
}
