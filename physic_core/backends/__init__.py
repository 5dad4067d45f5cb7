"""What core and backends share: devices and threads, memory, boxes and masks of people."""
