// The home page follows what is in progress.
import { follow } from './live.js';

follow(document.getElementById('now'), 'now');
