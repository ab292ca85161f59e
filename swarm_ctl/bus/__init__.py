"""What a swarm tells and is told over MQTT; nothing that flies waits for it."""
