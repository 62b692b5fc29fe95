"""The Preisach operator: the plane, its hysterons along an input, and the output of a model.

There is one law, y(k) = min(on_β, max(y(k-1), on_α)) (`plane.hysteron_step`), for relays and ramps
alike, and a way along the input for each thing that is asked of it. Times are those of 5,000
samples and 75 levels on one core, of ramps where nothing else is said:

| way | what only it gives | time |
|---|---|---|
| `simulation.simulate`, form "event" | cost that does not grow with the plane | 3 ms |
| `simulation.simulate`, form "dense" | initial states of one's own; the oracle of "event" | 92 ms |
| `states.hysteron_states`, `state_bounds` | regressors: all states at all samples | |
| `states.weighted_states` | unknown start, thresholds that move, in little memory | 210 ms |
| `states.fed_back_states` | an input that depends on the output | |
| `events.relay_blocks` | the adaptive filter of relays: 6 ms, and 250 ms sample by sample | 6 ms |
| `moves.adapt_over_moves` | that of ramps: 56 ms, and 280 ms sample by sample | 56 ms |
"""
